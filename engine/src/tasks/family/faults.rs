//! Creates the faults of TOML files, each with its line and field.

use std::ops::Range;

use crate::intake::Fault;
use crate::tasks::published::TaskFileFault;
use crate::text::reworded;

/// Returns the line of the byte at offset `at` of `text`, from 1.
fn line(text: &str, at: usize) -> u64 {
    text.bytes().take(at).filter(|byte| *byte == b'\n').count() as u64 + 1
}

/// Creates a fault of a field, at the line where its span begins.
pub fn at(file: &str, text: &str, span: &Range<usize>, field: &str, detail: impl Into<String>) -> TaskFileFault {
    let pointer = field.to_owned();
    TaskFileFault {
        file: file.to_owned(),
        fault: Fault { line: Some(line(text, span.start)), pointer, detail: detail.into() },
    }
}

/// Creates a fault of a file as a whole, without a line.
pub fn of_file(file: &str, detail: impl Into<String>) -> TaskFileFault {
    TaskFileFault { file: file.to_owned(), fault: Fault { line: None, pointer: String::new(), detail: detail.into() } }
}

/// Creates a fault from an error of the TOML parser.
pub fn of_toml(file: &str, text: &str, error: &toml::de::Error) -> TaskFileFault {
    let line = error.span().map(|span| line(text, span.start));
    let detail = reworded(&error.message().replace('\n', " "));
    TaskFileFault { file: file.to_owned(), fault: Fault { line, pointer: String::new(), detail } }
}
