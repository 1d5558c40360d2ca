//! `yawara verify`: is what the program promises true on this machine?

use anyhow::bail;
use serde_json::{Value, json};

use super::args::VerifyArguments;
use super::exit::Outcome;
use super::messages::{Messages, out};
use super::progress;
use crate::io::atomic::write_file;
use crate::verify::{Case, Finding, cases, markdown};

pub(super) fn verify(arguments: &VerifyArguments, messages: &Messages) -> anyhow::Result<Outcome> {
    let wanted = |case: &Case| arguments.only.as_ref().is_none_or(|text| case.name.contains(text.as_str()));
    let chosen: Vec<Case> = cases().into_iter().filter(wanted).collect();
    if chosen.is_empty() {
        let text = arguments.only.as_deref().unwrap_or_default();
        bail!("no case has `{text}` in its name; `yawara verify --list` tells them all");
    }
    if arguments.list {
        for case in &chosen {
            out(&format!("{}: {}", case.name, case.asked))?;
        }
        return Ok(Outcome::Done);
    }
    let bar = progress::bar(messages, "cases", chosen.len() as u64);
    let mut found: Vec<(Case, Finding)> = Vec::new();
    for case in chosen {
        let finding = (case.run)();
        if !arguments.json {
            let verdict = if finding.passed() { "kept" } else { "BROKEN" };
            let Finding { happened, error, allowed, .. } = &finding;
            bar.suspend(|| {
                out(&format!("{verdict}  {}: {happened} (error {error:.2e}, allowed {allowed:.1e})", case.name))
            })?;
        }
        found.push((case, finding));
        bar.inc(1);
    }
    bar.finish_and_clear();
    let kept = found.iter().filter(|(_, finding)| finding.passed()).count();
    if arguments.json {
        let cases: Vec<Value> = found.iter().map(|(case, finding)| to_json(case, finding)).collect();
        out(&json!({ "passed": kept == found.len(), "cases": cases }).to_string())?;
    }
    messages.note(format_args!("{kept} of {} kept", found.len()));
    if let Some(path) = &arguments.output {
        let only = arguments.only.as_ref().map_or(String::new(), |text| format!(" --only {text}"));
        let page = markdown(&found, &format!("yawara verify{only}"));
        write_file(path, |file| std::io::Write::write_all(file, page.as_bytes()))?;
        messages.note(format_args!("page: {}", path.display()));
    }
    Ok(if kept == found.len() { Outcome::Done } else { Outcome::CheckFailed })
}

fn to_json(case: &Case, finding: &Finding) -> Value {
    json!({
        "group": case.group.title(),
        "name": case.name,
        "asked": case.asked,
        "happened": finding.happened,
        "error": finding.error,
        "allowed": finding.allowed,
        "steps": finding.steps,
        "passed": finding.passed(),
    })
}
