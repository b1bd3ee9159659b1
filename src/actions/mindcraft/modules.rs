//! Modules that code may import: the ones of mindcraft and of the libraries that it uses.

use rquickjs::loader::{ImportAttributes, Loader, Resolver};
use rquickjs::module::Declared;
use rquickjs::{Ctx, Function, Module, Object};

/// Name of the global function that finds modules.
pub const FIND: &str = "plumbline:find";

/// Leaves names of modules as they are.
pub struct Names;

impl Resolver for Names {
    fn resolve<'js>(
        &mut self,
        _ctx: &Ctx<'js>,
        _base: &str,
        name: &str,
        _attributes: Option<ImportAttributes<'js>>,
    ) -> rquickjs::Result<String> {
        Ok(name.to_owned())
    }
}

/// Makes modules out of what the profile provides.
pub struct Provided;

impl Loader for Provided {
    fn load<'js>(
        &mut self,
        ctx: &Ctx<'js>,
        name: &str,
        _attributes: Option<ImportAttributes<'js>>,
    ) -> rquickjs::Result<Module<'js, Declared>> {
        let find: Function<'js> = ctx.globals().get(FIND)?;
        let found: Object<'js> = find.call((name,))?;
        let quoted = serde_json::to_string(name).unwrap_or_default();
        let mut source = format!("const it = globalThis[\"{FIND}\"]({quoted});\nexport default it;\n");
        for key in found.keys::<String>() {
            let key = key?;
            let is_name = !key.is_empty() && key.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
            if is_name && key != "default" {
                source.extend(["export const ", &key, " = it.", &key, ";\n"]);
            }
        }
        Module::declare(ctx.clone(), name, source)
    }
}
