//! Bodies of `/v1/grade`.

use plumbline::app::rewards::request::read_request;
use plumbline_engine::intake::Faults;

pub fn run(data: &[u8]) {
    let mut faults = Faults::new();
    let read = read_request(data, &mut faults);
    let is_read = matches!(read, Ok(Some(_)));
    assert!(is_read || read.is_err() || !faults.into_list().is_empty(), "it was refused without a reason");
}
