//! Values by name: the arguments of a check, or what it measured, in the words of the pages.

use serde_json::Value;

use plumbline_engine::text;

/// Values by name: the arguments of a check, or what it measured.
#[derive(Clone, Copy)]
pub(super) struct Args<'a>(pub(super) &'a Value);

impl<'a> Args<'a> {
    pub(super) fn number(self, name: &str) -> Option<f64> {
        self.0.get(name)?.as_f64()
    }

    /// A number as text, without a fraction where it has none.
    pub(super) fn told(self, name: &str) -> String {
        self.number(name).map_or_else(|| "?".to_owned(), plain)
    }

    pub(super) fn text(self, name: &str) -> Option<&'a str> {
        self.0.get(name)?.as_str()
    }

    pub(super) fn is(self, name: &str) -> bool {
        self.0.get(name).and_then(Value::as_bool).unwrap_or_default()
    }

    pub(super) fn count(self, name: &str) -> i64 {
        self.0.get(name).and_then(Value::as_i64).unwrap_or_default()
    }

    /// Materials of a list, such as "stone, then oak planks".
    pub(super) fn list(self, name: &str, between: &str) -> String {
        let all = self.0.get(name).and_then(Value::as_array).into_iter().flatten();
        all.filter_map(Value::as_str).map(material).collect::<Vec<_>>().join(between)
    }

    /// So many blocks of a material, if the check names one: "30 to 40 blocks", "at least 1 bed".
    pub(super) fn blocks(self, count: &str, of: &str) -> String {
        let (one, many) = match self.text(of) {
            None => ("block".to_owned(), "blocks".to_owned()),
            Some("#beds") => ("bed".to_owned(), "beds".to_owned()),
            Some("#doors") => ("door".to_owned(), "doors".to_owned()),
            Some("#passable") => {
                ("block that one walks through".to_owned(), "blocks that one walks through".to_owned())
            }
            Some(name) => (format!("block of {}", material(name)), format!("blocks of {}", material(name))),
        };
        format!("{count} {}", if is_one(count) { one } else { many })
    }

    /// The share that a check requires: "All" or "At least 50 % of".
    pub(super) fn share(self, name: &str) -> String {
        match self.number(name) {
            None => "All".to_owned(),
            Some(share) if share >= 1.0 => "All".to_owned(),
            Some(share) => format!("At least {} % of the", plain(share * 100.0)),
        }
    }
}

/// Writes a number with at most two digits after the point.
pub(super) fn plain(number: f64) -> String {
    let text = format!("{number:.2}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// Writes a material as people do: `#doors` and `_door` stand for a kind.
pub(super) fn material(name: &str) -> String {
    name.trim_start_matches(['#', '_']).replace('_', " ")
}

/// Returns whether a range ends in one, which takes the singular: "1", "at most 1".
pub(super) fn is_one(range: &str) -> bool {
    range.rsplit(' ').next() == Some("1")
}

/// A range, such as "49", "30 to 40", "at least 3" or "at most 5"; none if there is no bound.
pub(super) fn range(min: Option<f64>, max: Option<f64>) -> Option<String> {
    text::range(min.map(plain), max.map(plain))
}
