//! Draws the parameters of an instance of a hidden family.

use super::expand::is_true;
use super::template::{self, Context, Datum};
use super::{Family, Parameters, faults};
use crate::tasks::published::TaskFileFault;

impl Family {
    /// Draws parameters, where `choose(n)` picks a number below `n`. Returns `None` if they must be drawn again.
    ///
    /// # Errors
    /// Returns faults if the family has no `draw` rules, or one of them is faulty.
    pub fn draw(&self, choose: &mut dyn FnMut(u64) -> u64) -> Result<Option<Parameters>, Vec<TaskFileFault>> {
        let environment = template::environment();
        let at = |detail: String| vec![faults::of_file(&self.file, detail)];
        let rules = self.content.draw.as_ref().ok_or_else(|| at("draw: missing".to_owned()))?;
        let mut drawn = Parameters::new();
        let mut context = Context::new();
        for parameter in &rules.parameters {
            let field = format!("draw.parameters.{}", parameter.name);
            let value = match (parameter.from, &parameter.of, &parameter.is) {
                (Some([least, greatest]), None, None) if least <= greatest => {
                    (least + choose(least.abs_diff(greatest) + 1) as i64).into()
                }
                (None, Some(list), None) if !list.is_empty() => {
                    template::plain(&list[choose(list.len() as u64) as usize])
                }
                (None, None, Some(is)) => Datum::compile(&environment, is, &field)
                    .and_then(|datum| datum.value(&context))
                    .map_err(|misfit| vec![self.fault(&misfit)])?,
                _ => return Err(at(format!("{field}: expected exactly one of from, of and is, and not empty"))),
            };
            context.insert(parameter.name.clone(), template::value(&value));
            drawn.insert(parameter.name.clone(), value);
        }
        for only in &rules.only {
            let holds = Datum::expression(&environment, only, "draw.only").and_then(|datum| is_true(&datum, &context));
            if !holds.map_err(|misfit| vec![self.fault(&misfit)])? {
                return Ok(None);
            }
        }
        Ok(Some(drawn))
    }
}
