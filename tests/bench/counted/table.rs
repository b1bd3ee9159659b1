//! The committed table of counts, and the comparison with it.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::Command;

use crate::Count;

/// Part of a count by which it may differ from the table.
const TOLERANCE: f64 = 0.05;

fn file() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/bench/counted/counts.tsv")
}

/// Returns what the counts depend on besides the source: the compiler.
fn compiler() -> anyhow::Result<String> {
    let said = Command::new("rustc").arg("--version").output()?;
    Ok(String::from_utf8(said.stdout)?.split_whitespace().take(2).collect::<Vec<_>>().join(" "))
}

/// Returns the compiler of the table if it is another one than that of today: then no count can be compared.
///
/// # Errors
/// Returns an error if there is no table or no compiler.
pub fn other_compiler() -> anyhow::Result<Option<String>> {
    let text = std::fs::read_to_string(file())?;
    let theirs = text.lines().next().unwrap_or_default().trim_start_matches("# ");
    Ok((theirs != compiler()?).then(|| theirs.to_owned()))
}

/// Compares counts with the table.
///
/// # Errors
/// Returns an error that names each count that is too far from the table.
pub fn check(counts: &[Count]) -> anyhow::Result<()> {
    let text = std::fs::read_to_string(file())?;
    // The first line names the compiler.
    let rows = text.lines().skip(1);
    let row = |line: &str| line.split_once('\t').map(|(name, count)| Ok((name.to_owned(), count.parse::<u64>()?)));
    let mut known: BTreeMap<String, u64> = rows.filter_map(row).collect::<anyhow::Result<_>>()?;
    let mut faults = Vec::new();
    for (name, count) in counts {
        let Some(before) = known.remove(name) else {
            faults.push(format!("{name}: not in the table"));
            continue;
        };
        let ratio = *count as f64 / before as f64;
        println!("{ratio:6.3}  {count:>12}  {name}");
        if (ratio - 1.0).abs() > TOLERANCE {
            faults.push(format!("{name}: {count} instructions, {ratio:.3} times the {before} of the table"));
        }
    }
    faults.extend(known.into_keys().map(|name| format!("{name}: in the table, but not counted")));
    anyhow::ensure!(
        faults.is_empty(),
        "{}\nIf that is meant, `bash tests/bench/counted.sh --accept` writes the table anew.",
        faults.join("\n")
    );
    Ok(())
}

/// Writes the table.
///
/// # Errors
/// Returns an error if the file cannot be written.
pub fn write(counts: &[Count]) -> anyhow::Result<()> {
    let rows = counts.iter().map(|(name, count)| format!("{name}\t{count}\n"));
    let text: String = std::iter::once(format!("# {}\n", compiler()?)).chain(rows).collect();
    std::fs::write(file(), &text)?;
    print!("{text}");
    Ok(())
}
