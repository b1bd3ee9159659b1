//! Expands a family file into its tasks: the grid into items, wordings into prompts, expressions into arguments.

use std::collections::BTreeMap;

use minijinja::Environment;
use serde_json::{Map, Value};
use toml::Spanned;

use super::entailment::{Told, not_measured};
use super::manifest::Edition;
use super::template::{self, Context, Datum, Misfit, Place, Text};
use super::{CheckEntry, Family, Wording, faults};
use crate::checks::Check;
use crate::intake::Faults;
use crate::tasks::published::{TaskFileFault, read_check};
use crate::tasks::{Instruction, Task};
use crate::text::counted;

/// Parameters of an instance, by name.
pub type Parameters = Map<String, Value>;

/// Returns the points of the grid. The lists of a table vary together; tables multiply, the first varying slowest.
pub fn items(grid: &[BTreeMap<String, Spanned<Vec<toml::Value>>>]) -> Vec<Parameters> {
    let mut items = vec![Parameters::new()];
    for table in grid {
        let length = table.values().map(|values| values.get_ref().len()).max().unwrap_or(0);
        let point = |item: &Parameters, i: usize| {
            let values = table.iter().filter_map(|(name, values)| Some((name, values.get_ref().get(i)?)));
            let mut item = item.clone();
            item.extend(values.map(|(name, value)| (name.clone(), template::plain(value))));
            item
        };
        items = items.iter().flat_map(|item| (0..length).map(move |i| point(item, i))).collect();
    }
    items
}

/// The compiled templates of a family.
struct Compiled<'e> {
    family: &'e Family,
    instance: Text<'e>,
    words: Vec<(&'e str, Text<'e>)>,
    unmeasured: Vec<Text<'e>>,
    wordings: Vec<CompiledWording<'e>>,
    checks: Vec<CompiledCheck<'e>>,
}

struct CompiledWording<'e> {
    name: &'e str,
    when: Option<Datum<'e>>,
    words: Vec<(&'e str, Text<'e>)>,
    prompts: Vec<Text<'e>>,
    brief: Vec<Text<'e>>,
}

struct CompiledCheck<'e> {
    entry: &'e CheckEntry,
    place: Place,
    when: Option<Datum<'e>>,
    each: Option<(&'e str, Datum<'e>)>,
    args: Vec<(&'e str, Datum<'e>)>,
}

impl Family {
    /// Expands items into the tasks of a version of the suite, ordered by item, then wording. Their numbers are 0.
    ///
    /// # Errors
    /// Returns all faults found, each with its line and field.
    pub fn tasks(&self, items: &[Parameters], edition: &Edition<'_>) -> Result<Vec<Task>, Vec<TaskFileFault>> {
        let environment = template::environment();
        let mut found = self.faults_of_form();
        let compiled = Compiled::of(self, &environment).map_err(|misfit| vec![self.fault(&misfit)])?;
        let mut tasks = Vec::new();
        for item in items {
            match compiled.tasks_of(item, edition) {
                Ok(more) => tasks.extend(more),
                Err(misfits) => found.extend(misfits.iter().map(|misfit| self.fault(misfit))),
            }
        }
        // Reports a fault once, even if many items have it.
        found.sort_by(|a, b| (a.fault.line, &a.fault.pointer).cmp(&(b.fault.line, &b.fault.pointer)));
        found.dedup_by(|a, b| (a.fault.line, &a.fault.pointer) == (b.fault.line, &b.fault.pointer));
        if found.is_empty() { Ok(tasks) } else { Err(found) }
    }

    pub(super) fn fault(&self, misfit: &Misfit) -> TaskFileFault {
        faults::at(&self.file, &self.text, &misfit.place.span, &misfit.place.field, &misfit.detail)
    }

    /// Finds the faults that show without expansion, such as bad names and lists of a grid table that differ in length.
    fn faults_of_form(&self) -> Vec<TaskFileFault> {
        let at = |span, field: &str, detail: String| faults::at(&self.file, &self.text, &span, field, detail);
        let content = &self.content;
        let mut found = Vec::new();
        let names = content.wordings.iter().map(|wording| (&wording.name, "wordings.name"));
        let is_only = content.wordings.len() == 1;
        for (name, field) in names.chain([(&content.family, "family")]) {
            let is_left_out = is_only && field == "wordings.name" && name.get_ref().is_empty();
            if !is_left_out && !is_slug(name.get_ref()) {
                found.push(at(name.span(), field, format!("{:?} is not {SLUG}", name.get_ref())));
            }
        }
        for table in &content.grid {
            let longest = table.values().map(|values| values.get_ref().len()).max().unwrap_or(0);
            for (name, values) in table {
                let length = values.get_ref().len();
                if length != longest || length == 0 {
                    let field = format!("grid.{name}");
                    found.push(at(
                        values.span(),
                        &field,
                        format!("{}, but others have {longest}", counted(length, "value")),
                    ));
                }
            }
        }
        for (i, check) in content.checks.iter().enumerate() {
            if check.each.len() > 1 {
                let detail = "expected one variable".to_owned();
                found.push(at(check.name.span(), &format!("checks.{i}.each"), detail));
            }
        }
        if content.wordings.is_empty() {
            found.push(faults::of_file(&self.file, "wordings: the list is empty"));
        }
        found
    }
}

/// Rule for names, as faults state it.
const SLUG: &str = "a name of lower-case letters, digits and dashes";

fn is_slug(name: &str) -> bool {
    !name.is_empty() && name.bytes().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'-')
}

fn texts<'e>(
    environment: &'e Environment<'e>,
    words: &'e BTreeMap<String, Spanned<String>>,
    field: &str,
) -> Result<Vec<(&'e str, Text<'e>)>, Misfit> {
    let compile = |(name, text): (&'e String, &'e Spanned<String>)| {
        Ok((name.as_str(), Text::compile(environment, text, &format!("{field}.{name}"))?))
    };
    words.iter().map(compile).collect()
}

impl<'e> Compiled<'e> {
    fn of(family: &'e Family, environment: &'e Environment<'e>) -> Result<Self, Misfit> {
        let content = &family.content;
        let wording = |wording: &'e Wording| {
            let when = wording.when.as_ref().map(|when| Datum::expression(environment, when, "wordings.when"));
            let own = !wording.prompts.is_empty();
            let prompts = if own { &wording.prompts } else { &content.prompts };
            let field = if own { "wordings.prompts" } else { "prompts" };
            let own_brief = !wording.brief.is_empty();
            let brief = if own_brief { &wording.brief } else { &content.brief };
            let brief_field = if own_brief { "wordings.brief" } else { "brief" };
            Ok(CompiledWording {
                name: wording.name.get_ref(),
                when: when.transpose()?,
                words: texts(environment, &wording.words, "wordings.words")?,
                prompts: prompts.iter().map(|p| Text::compile(environment, p, field)).collect::<Result<_, _>>()?,
                brief: brief.iter().map(|p| Text::compile(environment, p, brief_field)).collect::<Result<_, _>>()?,
            })
        };
        Ok(Self {
            family,
            instance: Text::compile(environment, &content.instance, "instance")?,
            words: texts(environment, &content.words, "words")?,
            unmeasured: content
                .unmeasured
                .iter()
                .map(|text| Text::compile(environment, text, "unmeasured"))
                .collect::<Result<_, _>>()?,
            wordings: content.wordings.iter().map(wording).collect::<Result<_, _>>()?,
            checks: content
                .checks
                .iter()
                .enumerate()
                .map(|(i, entry)| CompiledCheck::of(entry, i, environment))
                .collect::<Result<_, _>>()?,
        })
    }

    fn tasks_of(&self, item: &Parameters, edition: &Edition<'_>) -> Result<Vec<Task>, Vec<Misfit>> {
        let one = |misfit| vec![misfit];
        let mut context: Context = item.iter().map(|(name, value)| (name.clone(), template::value(value))).collect();
        context.insert("version".to_owned(), edition.version.into());
        for (name, text) in edition.words {
            context.insert(name.clone(), text.as_str().into());
        }
        add_words(&mut context, &self.words).map_err(one)?;
        let unmeasured: Vec<String> =
            self.unmeasured.iter().map(|text| text.render(&context)).collect::<Result<_, _>>().map_err(one)?;
        context.insert("unmeasured".to_owned(), not_measured(&unmeasured).into());
        let instance = self.instance.render(&context).map_err(one)?;
        let mut tasks = Vec::new();
        for wording in &self.wordings {
            if let Some(when) = &wording.when
                && !is_true(when, &context).map_err(one)?
            {
                continue;
            }
            let mut context = context.clone();
            add_words(&mut context, &wording.words).map_err(one)?;
            let parts = [instance.as_str(), wording.name];
            let name = parts.into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join("-");
            let mut turns = Vec::with_capacity(wording.prompts.len());
            wording.must_fit(edition).map_err(|detail| vec![Misfit { place: self.instance.place.clone(), detail }])?;
            let mut told = Told::new(edition);
            for (i, prompt) in wording.prompts.iter().enumerate() {
                context.insert("turn".to_owned(), (i + 1).into());
                context.insert("turns".to_owned(), wording.prompts.len().into());
                // Checks may use the phrases of the wording and its number of turns.
                let (checks, informational) = self.checks(&context, edition.version)?;
                let prompt = prompt.render(&context).map_err(one)?;
                let brief = wording.brief.get(i).map(|text| text.render(&context)).transpose().map_err(one)?;
                told.turn(&prompt, brief.as_deref());
                if edition.every_check_is_asked_for {
                    self.must_be_asked(&context, edition.version, &told)?;
                }
                turns.push(Instruction { prompt, brief, checks, informational });
            }
            if turns.is_empty() {
                let detail = "neither the wording nor the family has prompts".to_owned();
                return Err(vec![Misfit { place: self.instance.place.clone(), detail }]);
            }
            tasks.push(Task {
                id: format!("{}/{name}", self.family.name()),
                number: 0,
                category: Some(self.family.content.category),
                kind: Some(self.family.content.kind.clone()),
                parameters: item.clone(),
                reading: edition.reading,
                unmeasured: unmeasured.clone(),
                turns,
            });
        }
        Ok(tasks)
    }

    /// Finds the checks of a turn that no phrase asks for, and a list of what is not measured that no prompt tells.
    fn must_be_asked(&self, context: &Context, version: u32, told: &Told) -> Result<(), Vec<Misfit>> {
        let mut misfits = Vec::new();
        for check in self.checks.iter().filter(|check| check.entry.counts_in(version)) {
            if !check.instances(context).map_err(|misfit| vec![misfit])?.is_empty() {
                misfits.extend(told.lacks(check.entry, &check.place, context));
            }
        }
        let unmeasured = context.get("unmeasured").and_then(|text| text.as_str()).unwrap_or_default();
        if !told.admits(unmeasured) {
            let place = self.unmeasured.first().map_or(&self.instance.place, |text| &text.place);
            let detail = "no prompt contains {{ unmeasured }}".to_owned();
            misfits.push(Misfit { place: place.clone(), detail });
        }
        if misfits.is_empty() { Ok(()) } else { Err(misfits) }
    }

    /// Returns the checks of a turn: those that count, and those that are informational.
    fn checks(&self, context: &Context, version: u32) -> Result<(Vec<Check>, Vec<Check>), Vec<Misfit>> {
        let (mut counting, mut shown, mut misfits) = (Vec::new(), Vec::new(), Vec::new());
        for check in self.checks.iter().filter(|check| check.entry.since <= version) {
            let is_shown = check.entry.informational_since.is_some_and(|since| since <= version);
            match check.instances(context) {
                Ok(checks) if is_shown => shown.extend(checks),
                Ok(checks) => counting.extend(checks),
                Err(misfit) => misfits.push(misfit),
            }
        }
        if misfits.is_empty() { Ok((counting, shown)) } else { Err(misfits) }
    }
}

impl CompiledWording<'_> {
    /// Tells what is wrong if the wording lacks prompts of the track `brief` that the suite has.
    fn must_fit(&self, edition: &Edition<'_>) -> Result<(), String> {
        let wanted = if edition.preamble.is_some() { self.prompts.len() } else { 0 };
        if self.brief.len() == wanted {
            return Ok(());
        }
        let [has, wants] = [self.brief.len(), wanted].map(|number| counted(number, "brief prompt"));
        Err(format!(
            "the wording {:?} has {has}, and needs {wants}: one per turn if the suite has a preamble",
            self.name
        ))
    }
}

fn add_words(context: &mut Context, words: &[(&str, Text<'_>)]) -> Result<(), Misfit> {
    for (name, text) in words {
        let text = text.render(context)?;
        context.insert((*name).to_owned(), text.into());
    }
    Ok(())
}

pub(super) fn is_true(when: &Datum<'_>, context: &Context) -> Result<bool, Misfit> {
    let value = when.value(context)?;
    value
        .as_bool()
        .ok_or_else(|| Misfit { place: when.place.clone(), detail: format!("expected true or false, found {value}") })
}

impl<'e> CompiledCheck<'e> {
    fn of(entry: &'e CheckEntry, index: usize, environment: &'e Environment<'e>) -> Result<Self, Misfit> {
        let field = |part: &str| format!("checks.{index}.{part}");
        let expression = |text, part: &str| Datum::expression(environment, text, &field(part));
        let each = entry.each.iter().next().map(|(name, list)| Ok((name.as_str(), expression(list, "each")?)));
        let arg = |(name, value): (&'e String, &'e Spanned<toml::Value>)| {
            Ok((name.as_str(), Datum::compile(environment, value, &field(&format!("args.{name}")))?))
        };
        Ok(Self {
            entry,
            place: Place { span: entry.name.span(), field: field("fn") },
            when: entry.when.as_ref().map(|when| expression(when, "when")).transpose()?,
            each: each.transpose()?,
            args: entry.args.iter().map(arg).collect::<Result<_, _>>()?,
        })
    }

    fn instances(&self, context: &Context) -> Result<Vec<Check>, Misfit> {
        if let Some(when) = &self.when
            && !is_true(when, context)?
        {
            return Ok(Vec::new());
        }
        let Some((name, list)) = &self.each else { return Ok(vec![self.instance(context)?]) };
        let values = list.value(context)?;
        let Some(values) = values.as_array() else {
            return Err(Misfit { place: list.place.clone(), detail: format!("expected an array, found {values}") });
        };
        let mut context = context.clone();
        let mut checks = Vec::with_capacity(values.len());
        for value in values {
            context.insert((*name).to_owned(), template::value(value));
            checks.push(self.instance(&context)?);
        }
        Ok(checks)
    }

    fn instance(&self, context: &Context) -> Result<Check, Misfit> {
        let mut args = Map::new();
        for (name, datum) in &self.args {
            args.insert((*name).to_owned(), datum.value(context)?);
        }
        let mut faults = Faults::new();
        let check = read_check(&serde_json::json!({ "fn": self.entry.name.get_ref(), "args": args }), &mut faults);
        check.ok_or_else(|| {
            let fault = faults.into_list().into_iter().next().expect("a check that cannot be read has a fault");
            let mut place = self.place.clone();
            // The place is that of `fn`, and the fault's begins there or at `args` beside it.
            if let Some(of_check) = place.field.strip_suffix("fn") {
                place.field = format!("{of_check}{}", fault.pointer.trim_start_matches('/').replace('/', "."));
            }
            Misfit { place, detail: fault.detail }
        })
    }
}

#[cfg(test)]
#[path = "expand_tests.rs"]
mod tests;
