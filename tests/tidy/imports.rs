//! Imports between files: read from the text, followed through re-exports, and searched for rings.

use std::collections::{BTreeMap, BTreeSet};

/// A path of modules, from the root of the crate.
type Module = Vec<String>;

/// The text without its tests, which may import what they like.
pub fn without_tests(text: &str) -> &str {
    text.split("#[cfg(test)]\nmod tests {").next().unwrap_or_default()
}

/// Files of a crate that import each other in a ring; each ring once, as names of files.
pub fn rings(folder: &str, sources: &[(String, String)]) -> Vec<Vec<String>> {
    let modules: BTreeMap<Module, &str> =
        sources.iter().map(|(name, text)| (module_of(folder, name), &**text)).collect();
    let exports: BTreeMap<Module, BTreeMap<String, Module>> =
        modules.iter().map(|(module, text)| (module.clone(), re_exports(module, text, &modules))).collect();
    let imports: BTreeMap<&Module, BTreeSet<Module>> = modules
        .iter()
        .map(|(module, text)| {
            let code = without_tests(text);
            let uses = used_paths(code).into_iter().filter(|(is_public, _)| !is_public).map(|(_, path)| path);
            let paths = uses.chain(inline_paths(code));
            let targets = paths.filter_map(|path| resolve(&absolute(module, &path)?, &modules, &exports));
            // A folder's mod.rs puts its files together, so its imports of them are no way back up.
            (module, targets.filter(|target| !target.starts_with(module)).collect())
        })
        .collect();
    let reaches = |from: &Module| {
        let (mut seen, mut todo) = (BTreeSet::new(), vec![from]);
        while let Some(next) = todo.pop() {
            for target in &imports[next] {
                if seen.insert(target.clone()) {
                    todo.push(imports.get_key_value(target).unwrap().0);
                }
            }
        }
        seen
    };
    let reached: BTreeMap<&Module, BTreeSet<Module>> = modules.keys().map(|module| (module, reaches(module))).collect();
    let mut found = BTreeSet::new();
    for module in modules.keys().filter(|module| reached[*module].contains(*module)) {
        let ring = modules.keys().filter(|other| reached[module].contains(*other) && reached[*other].contains(module));
        found.insert(ring.map(|module| module.join("::")).collect::<Vec<_>>());
    }
    found.into_iter().collect()
}

fn module_of(folder: &str, name: &str) -> Module {
    let path = name.trim_start_matches(folder).trim_start_matches('/').trim_end_matches(".rs");
    let mut parts: Module = path.split('/').map(str::to_owned).collect();
    if matches!(parts.last().map(String::as_str), Some("mod" | "lib" | "main")) {
        parts.pop();
    }
    parts
}

/// Paths in `use` statements, each with whether it is exported again.
fn used_paths(text: &str) -> Vec<(bool, String)> {
    let mut paths = Vec::new();
    let code: String = text.lines().filter(|line| !line.trim_start().starts_with("//")).collect::<Vec<_>>().join(" ");
    for part in code.split("use ").skip(1) {
        let Some((tree, _)) = part.split_once(';') else { continue };
        let before = code[..part.as_ptr() as usize - code.as_ptr() as usize].trim_end_matches("use ").trim_end();
        let is_public = before.ends_with("pub");
        expand(tree.trim(), "", &mut |path| paths.push((is_public, path)));
    }
    paths
}

/// Paths from the root of the crate that stand in code instead of in `use` statements.
fn inline_paths(text: &str) -> Vec<String> {
    let code = text.lines().map(str::trim_start).filter(|line| !line.starts_with("//") && !line.starts_with("use "));
    let parts = code.flat_map(|line| line.split("crate::").skip(1));
    let is_path = |c: &char| c.is_alphanumeric() || matches!(c, '_' | ':');
    parts.map(|part| format!("crate::{}", part.chars().take_while(is_path).collect::<String>())).collect()
}

/// Gives every path of a tree such as `a::{b, c::{d, e}}`.
fn expand(tree: &str, prefix: &str, take: &mut dyn FnMut(String)) {
    let Some((head, rest)) = tree.split_once('{') else {
        let path = tree.split(" as ").next().unwrap_or_default().trim();
        return take(format!("{prefix}{path}"));
    };
    let inner = rest.trim_end().strip_suffix('}').unwrap_or(rest);
    let (mut depth, mut start) = (0, 0);
    let prefix = format!("{prefix}{}", head.trim());
    for (i, c) in inner.char_indices() {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                expand(inner[start..i].trim(), &prefix, take);
                start = i + 1;
            }
            _ => {}
        }
    }
    if !inner[start..].trim().is_empty() {
        expand(inner[start..].trim(), &prefix, take);
    }
}

/// A path from the root of the crate; none where it leads out of the crate.
fn absolute(module: &Module, path: &str) -> Option<Module> {
    let mut parts = path.split("::").map(str::trim);
    let mut base = match parts.clone().next()? {
        "crate" => Vec::new(),
        "super" => module[..module.len().checked_sub(1)?].to_vec(),
        "self" => module.clone(),
        // Children of this module are named without a prefix.
        _ => return Some(module.iter().cloned().chain(parts.map(str::to_owned)).collect()),
    };
    parts.next();
    base.extend(parts.map(str::to_owned));
    Some(base)
}

/// The module that a path leads to, through what modules export again.
fn resolve(
    path: &Module,
    modules: &BTreeMap<Module, &str>,
    exports: &BTreeMap<Module, BTreeMap<String, Module>>,
) -> Option<Module> {
    let length = (1..=path.len()).rev().find(|length| modules.contains_key(&path[..*length]))?;
    let module = path[..length].to_vec();
    let exported = path.get(length).and_then(|name| exports.get(&module)?.get(name));
    Some(exported.cloned().unwrap_or(module))
}

fn re_exports(module: &Module, text: &str, modules: &BTreeMap<Module, &str>) -> BTreeMap<String, Module> {
    let public = used_paths(without_tests(text)).into_iter().filter(|(is_public, _)| *is_public);
    let absolutes = public.filter_map(|(_, path)| absolute(module, &path));
    let known = |path: Module| {
        let length = (1..path.len()).rev().find(|length| modules.contains_key(&path[..*length]))?;
        Some((path.last()?.clone(), path[..length].to_vec()))
    };
    absolutes.filter_map(known).collect()
}
