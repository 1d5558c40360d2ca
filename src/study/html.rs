//! The report as one file for a browser, with its pictures inside.
//!
//! It understands the Markdown that [`super::report`] writes and no more: headings, paragraphs, lists, tables, pictures on lines of
//! their own, `code`, **bold** and *slanted* words.

use std::fmt::Write;

const HEAD: &str = "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<style>\n\
body { font: 16px/1.5 system-ui, sans-serif; color: #26282c; max-width: 75em; margin: 2em auto; padding: 0 1em; }\n\
table { border-collapse: collapse; font-size: 14px; display: block; overflow-x: auto; }\n\
th, td { border: 1px solid #dee1e5; padding: 0.25em 0.6em; text-align: left; }\n\
th { background: #f0f1f3; }\nimg { max-width: 100%; }\ncode { background: #f0f1f3; }\n</style>\n";

/// Turns a report into a page.
///
/// - `picture`: the bytes of a picture by its name (PNG); without them the picture is left out.
///
/// # Panics
/// Never: writing to a string does not fail.
pub fn page(markdown: &str, picture: impl Fn(&str) -> Option<Vec<u8>>) -> String {
    let mut html = HEAD.to_owned();
    let title = markdown.lines().find_map(|line| line.strip_prefix("# ")).unwrap_or_default();
    write!(html, "<title>{}</title>\n</head>\n<body>\n", escaped(title)).expect("text");
    for block in markdown.split("\n\n").map(str::trim).filter(|block| !block.is_empty()) {
        // A heading may stand right above what follows.
        write_block(&mut html, block, &picture);
    }
    html.push_str("</body>\n</html>\n");
    html
}

fn write_block(html: &mut String, block: &str, picture: &impl Fn(&str) -> Option<Vec<u8>>) {
    let lines: Vec<&str> = block.lines().collect();
    if let Some(text) = block.strip_prefix("# ") {
        writeln!(html, "<h1>{}</h1>", inline(text)).expect("text");
    } else if let Some(text) = block.strip_prefix("## ") {
        writeln!(html, "<h2>{}</h2>", inline(text)).expect("text");
    } else if let Some((alt, name)) = block.strip_prefix("![").and_then(|rest| rest.strip_suffix(')')?.split_once("]("))
    {
        if let Some(bytes) = picture(name) {
            let (alt, data) = (escaped(alt), base64(&bytes));
            writeln!(html, "<p><img alt=\"{alt}\" src=\"data:image/png;base64,{data}\"></p>").expect("text");
        }
    } else if lines.iter().all(|line| line.starts_with("- ")) {
        html.push_str("<ul>\n");
        for line in lines {
            writeln!(html, "<li>{}</li>", inline(&line[2..])).expect("text");
        }
        html.push_str("</ul>\n");
    } else if lines.len() > 1 && lines.iter().all(|line| line.starts_with('|')) {
        html.push_str("<table>\n");
        // The second line only says how columns are aligned.
        for (number, line) in lines.iter().enumerate().filter(|(number, _)| *number != 1) {
            let kind = if number == 0 { "th" } else { "td" };
            let cells =
                line.trim_matches('|').split('|').map(|cell| format!("<{kind}>{}</{kind}>", inline(cell.trim())));
            writeln!(html, "<tr>{}</tr>", cells.collect::<String>()).expect("text");
        }
        html.push_str("</table>\n");
    } else {
        writeln!(html, "<p>{}</p>", inline(block)).expect("text");
    }
}

/// Text with its marks: between two of a kind stands what they mean.
fn inline(text: &str) -> String {
    let mut html = String::new();
    for (number, part) in text.split('`').enumerate() {
        if number % 2 == 1 {
            write!(html, "<code>{}</code>", escaped(part)).expect("text");
            continue;
        }
        for (number, part) in part.split("**").enumerate() {
            let slanted = part.split('*').enumerate().map(|(number, part)| {
                if number % 2 == 1 { format!("<em>{}</em>", escaped(part)) } else { escaped(part) }
            });
            let slanted: String = slanted.collect();
            html.push_str(&if number % 2 == 1 { format!("<strong>{slanted}</strong>") } else { slanted });
        }
    }
    html
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// RFC 4648, section 4.
fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for chunk in bytes.chunks(3) {
        let bits = (0..3).fold(0_u32, |bits, n| bits << 8 | u32::from(chunk.get(n).copied().unwrap_or(0)));
        for digit in 0..4 {
            let known = digit <= chunk.len();
            text.push(if known { DIGITS[(bits >> (18 - 6 * digit) & 63) as usize].into() } else { '=' });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_examples_of_the_standard() {
        // RFC 4648, section 10.
        let cases =
            [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foob", "Zm9vYg=="), ("foobar", "Zm9vYmFy")];
        for (text, expected) in cases {
            assert_eq!(base64(text.as_bytes()), expected);
        }
    }

    #[test]
    fn what_reports_are_made_of() {
        let text =
            "# A <b>\n\n- one\n- *two*\n\n| a | b |\n|---|---:|\n| 1 | `x*y` |\n\n![Error](e.png)\n\nA **word**.";
        let html = page(text, |name| (name == "e.png").then(|| b"foo".to_vec()));
        for part in [
            "<title>A &lt;b&gt;</title>",
            "<h1>A &lt;b&gt;</h1>",
            "<li>one</li>\n<li><em>two</em></li>",
            "<tr><th>a</th><th>b</th></tr>\n<tr><td>1</td><td><code>x*y</code></td></tr>",
            "<img alt=\"Error\" src=\"data:image/png;base64,Zm9v\">",
            "<p>A <strong>word</strong>.</p>",
        ] {
            assert!(html.contains(part), "{part}: {html}");
        }
    }
}
