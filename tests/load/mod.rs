//! One client against the others. These tests want the machine to themselves: `tests/run` starts them one at a time.

mod attacks;
