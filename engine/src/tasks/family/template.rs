//! Templates of family files: texts and values that contain expressions of the parameters.

use std::collections::BTreeMap;
use std::ops::Range;

use minijinja::value::Serde;
use minijinja::{Environment, Error, ErrorKind, Expression, Template, UndefinedBehavior};
use serde_json::Value;
use toml::Spanned;

/// Values that templates can use, by name.
pub type Context = BTreeMap<String, minijinja::Value>;

/// Creates the environment of templates, with the filter and the function that they can use.
pub fn environment<'a>() -> Environment<'a> {
    let mut environment = Environment::new();
    environment.set_undefined_behavior(UndefinedBehavior::Strict);
    environment.set_auto_escape_callback(|_| minijinja::AutoEscape::None);
    environment.add_filter("spelled", spelled);
    environment.add_function("count", count);
    environment
}

/// Spells a number, e.g. `three` for `3`; numbers below zero or above twelve stay digits.
fn spelled(number: i64) -> String {
    const WORDS: [&str; 13] =
        ["no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve"];
    usize::try_from(number).ok().and_then(|i| WORDS.get(i)).map_or_else(|| number.to_string(), ToString::to_string)
}

/// Spells a number with its noun, e.g. `three rooms` for `count(3, "room")`.
fn count(number: i64, noun: &str) -> String {
    format!("{} {noun}{}", spelled(number), if number == 1 { "" } else { "s" })
}

/// Renders a text in which the variables are these words.
///
/// # Errors
/// Returns the reason if the text has a syntax error or uses another variable.
pub fn rendered(text: &str, words: &BTreeMap<String, String>) -> Result<String, String> {
    let rendered = environment().render_str(text, words).map_err(|error| error.to_string())?;
    Ok(rendered.split_whitespace().collect::<Vec<_>>().join(" "))
}

/// Location in a family file, for faults.
#[derive(Debug, Clone)]
pub struct Place {
    /// Range of bytes in the file.
    pub span: Range<usize>,
    /// Path of the field from the top of the file, joined by dots.
    pub field: String,
}

/// A compiled text with its location.
pub struct Text<'e> {
    template: Template<'e, 'e>,
    /// Location of the text.
    pub place: Place,
}

impl<'e> Text<'e> {
    /// Compiles a text.
    ///
    /// # Errors
    /// Returns the fault if the text has a syntax error.
    pub fn compile(environment: &'e Environment<'e>, text: &'e Spanned<String>, field: &str) -> Result<Self, Misfit> {
        let place = Place { span: text.span(), field: field.to_owned() };
        match environment.template_from_str(text.get_ref()) {
            Ok(template) => Ok(Self { template, place }),
            Err(error) => Err(Misfit::new(&place, &error)),
        }
    }

    /// Renders the text with its expressions replaced. Trims it, and makes each run of whitespace a single space.
    ///
    /// # Errors
    /// Returns the fault if an expression cannot be evaluated.
    pub fn render(&self, context: &Context) -> Result<String, Misfit> {
        let text = self.template.render(context).map_err(|error| Misfit::new(&self.place, &error))?;
        Ok(text.split_whitespace().collect::<Vec<_>>().join(" "))
    }
}

/// A compiled value, which may depend on the parameters.
enum Node<'e> {
    Fixed(Value),
    Computed(Expression<'e, 'e>),
    Text(Template<'e, 'e>),
    List(Vec<Self>),
}

/// A compiled value with its location.
pub struct Datum<'e> {
    node: Node<'e>,
    /// Location of the value.
    pub place: Place,
}

impl<'e> Datum<'e> {
    /// Compiles a value. A string that is a single `{{ … }}` is an expression; other strings are texts.
    ///
    /// # Errors
    /// Returns the fault if an expression has a syntax error, or the value is a date or a table.
    pub fn compile(
        environment: &'e Environment<'e>,
        value: &'e Spanned<toml::Value>,
        field: &str,
    ) -> Result<Self, Misfit> {
        let place = Place { span: value.span(), field: field.to_owned() };
        match node(environment, value.get_ref()) {
            Ok(node) => Ok(Self { node, place }),
            Err(error) => Err(Misfit::new(&place, &error)),
        }
    }

    /// Compiles a bare expression.
    ///
    /// # Errors
    /// Returns the fault if the text has a syntax error.
    pub fn expression(
        environment: &'e Environment<'e>,
        text: &'e Spanned<String>,
        field: &str,
    ) -> Result<Self, Misfit> {
        let place = Place { span: text.span(), field: field.to_owned() };
        match environment.compile_expression(text.get_ref()) {
            Ok(expression) => Ok(Self { node: Node::Computed(expression), place }),
            Err(error) => Err(Misfit::new(&place, &error)),
        }
    }

    /// Evaluates the value.
    ///
    /// # Errors
    /// Returns the fault if an expression cannot be evaluated.
    pub fn value(&self, context: &Context) -> Result<Value, Misfit> {
        evaluate(&self.node, context).map_err(|error| Misfit::new(&self.place, &error))
    }
}

fn node<'e>(environment: &'e Environment<'e>, value: &'e toml::Value) -> Result<Node<'e>, Error> {
    Ok(match value {
        toml::Value::String(text) => match whole_expression(text) {
            Some(expression) => Node::Computed(environment.compile_expression(expression)?),
            None if text.contains('{') => Node::Text(environment.template_from_str(text)?),
            None => Node::Fixed(Value::String(text.clone())),
        },
        toml::Value::Array(items) => {
            Node::List(items.iter().map(|item| node(environment, item)).collect::<Result<_, _>>()?)
        }
        toml::Value::Integer(_) | toml::Value::Float(_) | toml::Value::Boolean(_) => Node::Fixed(plain(value)),
        toml::Value::Datetime(_) | toml::Value::Table(_) => {
            return Err(Error::new(
                ErrorKind::InvalidOperation,
                "expected a number, a string, true, false or an array",
            ));
        }
    })
}

/// Converts a JSON value to one that templates can use.
pub fn value(value: &Value) -> minijinja::Value {
    minijinja::Value::from(Serde(value))
}

/// Converts a TOML value to JSON.
pub fn plain(value: &toml::Value) -> Value {
    serde_json::to_value(value).expect("values of templates are JSON")
}

fn whole_expression(text: &str) -> Option<&str> {
    let inside = text.trim().strip_prefix("{{")?.strip_suffix("}}")?;
    (!inside.contains("{{")).then_some(inside)
}

fn evaluate(node: &Node<'_>, context: &Context) -> Result<Value, Error> {
    Ok(match node {
        Node::Fixed(value) => value.clone(),
        Node::Computed(expression) => {
            let value = expression.eval(context)?;
            if value.is_undefined() {
                return Err(Error::new(ErrorKind::UndefinedError, "no such parameter"));
            }
            serde_json::to_value(&value).map_err(|error| Error::new(ErrorKind::BadSerialization, error.to_string()))?
        }
        Node::Text(template) => Value::String(template.render(context)?),
        Node::List(items) => Value::Array(items.iter().map(|item| evaluate(item, context)).collect::<Result<_, _>>()?),
    })
}

/// A fault in a template and its location.
#[derive(Debug, Clone)]
pub struct Misfit {
    /// Location of the template.
    pub place: Place,
    /// Description of the fault.
    pub detail: String,
}

impl Misfit {
    fn new(place: &Place, error: &Error) -> Self {
        let detail =
            error.detail().map_or_else(|| error.kind().to_string(), |detail| format!("{}: {detail}", error.kind()));
        Self { place: place.clone(), detail }
    }
}
