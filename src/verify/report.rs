//! The page of findings.

use std::fmt::Write;

use super::{Case, Finding, Group};

/// Cases with their findings as a Markdown page, one table per group. `command`: what wrote it.
///
/// # Panics
/// Never: writing to a string does not fail.
pub fn markdown(found: &[(Case, Finding)], command: &str) -> String {
    let kept = found.iter().filter(|(_, finding)| finding.passed()).count();
    let mut page = format!("# What yawara promises, tried out\n\n`{command}`: {kept} of {} kept.\n", found.len());
    let mut group: Option<Group> = None;
    for (case, finding) in found {
        if group != Some(case.group) {
            group = Some(case.group);
            let title = case.group.title();
            write!(page, "\n## {title}\n\n| case | asked | what happened | largest error | allowed | steps |\n")
                .expect("text");
            page.push_str("|---|---|---|---|---|---|\n");
        }
        let Finding { happened, error, allowed, steps } = finding;
        let failed = if finding.passed() { "" } else { "**FAILED** " };
        let Case { name, asked, .. } = case;
        writeln!(page, "| {name} | {asked} | {failed}{happened} | {error:.2e} | {allowed:.1e} | {steps} |")
            .expect("text");
    }
    page
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_broken_promise_stands_out() {
        let finding = |error| Finding { happened: "it bent".into(), error, allowed: 1e-3, steps: 7 };
        let case = |name, group| Case { group, name, asked: "that it bends", run: || unreachable!() };
        let found = [(case("good", Group::Solids), finding(1e-4)), (case("bad", Group::Hard), finding(f64::NAN))];
        let page = markdown(&found, "yawara verify");
        assert!(page.contains("`yawara verify`: 1 of 2 kept."), "{page}");
        assert!(
            page.contains("## Hard cases")
                && page.contains("| bad | that it bends | **FAILED** it bent | NaN | 1.0e-3 | 7 |")
        );
    }
}
