//! Every relative link in Markdown leads to a file or folder of the tree.

use super::Finding;
use retrace_task_support::tree::Tree;

pub(super) fn find(tree: &Tree) -> Vec<Finding> {
    let mut findings = Vec::new();
    for (path, text) in tree.texts().filter(|(path, _)| path.ends_with(".md")) {
        let mut in_fence = false;
        for (index, line) in text.lines().enumerate() {
            if line.trim_start().starts_with("```") {
                in_fence = !in_fence;
            }
            if in_fence {
                continue;
            }
            for target in targets(line) {
                match resolved(path, target) {
                    Some(place) if tree.has(&place) => {}
                    Some(_) => findings.push(Finding::at(path, index + 1, format!("`{target}` leads nowhere"))),
                    None => findings.push(Finding::at(path, index + 1, format!("`{target}` leads out of the tree"))),
                }
            }
        }
    }
    findings
}

/// The relative targets of the links in a line, without anchors and titles; code spans hold no links.
pub(super) fn targets(line: &str) -> Vec<&str> {
    let mut found = Vec::new();
    let mut rest = line;
    while let Some(at) = rest.find(['`', ']']) {
        if let Some(code) = rest[at..].strip_prefix('`') {
            rest = code.find('`').map_or("", |end| &code[end + 1..]);
            continue;
        }
        rest = &rest[at + 1..];
        let target = if let Some(inline) = rest.strip_prefix('(') {
            inline.split(')').next()
        } else if let (Some(definition), true) = (rest.strip_prefix(": "), line.starts_with('[')) {
            Some(definition)
        } else {
            None
        };
        let Some(target) = target.and_then(|target| target.split_whitespace().next()) else { continue };
        let target = target.trim_matches(['<', '>']);
        let file = target.split('#').next().unwrap_or_default();
        if !file.is_empty() && !target.contains("://") && !target.starts_with("mailto:") {
            found.push(file);
        }
    }
    found
}

/// The path from the root that `target` means in the file at `path`; none where it leaves the tree.
pub(super) fn resolved(path: &str, target: &str) -> Option<String> {
    let mut parts: Vec<&str> = path.split('/').collect();
    parts.pop();
    for part in target.split('/') {
        match part {
            "" | "." => {}
            ".." => {
                parts.pop()?;
            }
            name => parts.push(name),
        }
    }
    Some(parts.join("/"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn broken_links_are_refused_and_good_ones_are_not() {
        let text = "[a](b.md) ![c](../x/d.svg \"t\") [e](https://f.org) [g](#h) `[i](j)`\n\
                    [k](l.md#m) and [n](../../o)\n```\n[p](q)\n```\n[r]: s.md\n[u](../x) [v](<b.md>)\n";
        let tree = Tree::of(&[("docs/a.md", text), ("docs/b.md", ""), ("x/d.svg", "")]);
        let found: Vec<_> = find(&tree).into_iter().map(|finding| (finding.line, finding.message)).collect();
        assert_eq!(
            found,
            [
                (2, "`l.md` leads nowhere".to_owned()),
                (2, "`../../o` leads out of the tree".to_owned()),
                (6, "`s.md` leads nowhere".to_owned())
            ]
        );
    }
}
