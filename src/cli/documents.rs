//! The documents' command lines are those of this command: they are parsed by its own parser.

use std::path::{Path, PathBuf};

use clap::{CommandFactory, Parser};

use super::Cli;

/// Options of cargo and of other programs that the documents name without them.
const OPTIONS_OF_OTHERS: [&str; 1] = ["--bench"];

/// Markdown files about this version. The changelog is about others, too.
fn documents() -> Vec<(PathBuf, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut paths =
        ["README.md", "CONTRIBUTING.md", "shaders/README.md", "envmaps/README.md"].map(|name| root.join(name)).to_vec();
    let docs = std::fs::read_dir(root.join("docs")).unwrap().map(|entry| entry.unwrap().path());
    paths.extend(docs.filter(|path| path.extension().is_some_and(|extension| extension == "md")));
    paths.into_iter().map(|path| (path.clone(), std::fs::read_to_string(path).unwrap())).collect()
}

/// The lines of blocks of code in a language, and the text outside of all blocks.
fn blocks<'a>(text: &'a str, language: &str) -> (Vec<&'a str>, String) {
    let (mut code, mut prose, mut within) = (Vec::new(), String::new(), None);
    for line in text.lines() {
        match (line.trim().strip_prefix("```"), within) {
            (Some(of), None) => within = Some(of),
            (Some(_), Some(_)) => within = None,
            (None, Some(of)) if of.split(',').next() == Some(language) => code.push(line.trim()),
            (None, Some(_)) => {}
            (None, None) => prose.extend([line, "\n"]),
        }
    }
    (code, prose)
}

/// The words of a line of the shell that this command would get, if it is called there. Dots stand for words that are left out.
fn arguments(line: &str) -> Option<Vec<&str>> {
    let words = line.split_whitespace().take_while(|word| !word.starts_with(['#', '>', '|']));
    let words: Vec<&str> = words.filter(|word| *word != "...").collect();
    let is_command = |word: &&str| *word == "pinspot" || word.ends_with("/pinspot");
    let from = if words.starts_with(&["cargo", "run"]) && !words.contains(&"--example") {
        words.iter().position(|word| *word == "--")
    } else {
        words.iter().position(is_command)
    };
    from.map(|from| words[from + 1..].to_vec())
}

/// Whether a subcommand, or any if there is none of that name, has an option.
fn has_option(subcommand: Option<&str>, option: &str) -> bool {
    let long = option.trim_start_matches('-').split('=').next().unwrap();
    let command = Cli::command();
    let mut candidates =
        command.get_subcommands().filter(|known| subcommand.is_none_or(|name| known.get_name() == name));
    ["help", "version"].contains(&long)
        || candidates.any(|known| known.get_arguments().any(|argument| argument.get_long() == Some(long)))
}

#[test]
fn lines_of_the_shell_are_parsed() {
    let mut count = 0;
    for (path, text) in documents() {
        let lines = blocks(&text, "sh").0.join("\n").replace("\\\n", " ");
        for line in lines.lines() {
            let Some(arguments) = arguments(line) else { continue };
            count += 1;
            let parsed = Cli::try_parse_from([&["pinspot"][..], &arguments].concat());
            let is_right = parsed.as_ref().err().is_none_or(|error| !error.use_stderr());
            assert!(is_right, "{}: {line}\n{}", path.display(), parsed.unwrap_err());
        }
    }
    assert!(count > 40, "{count} lines");
}

/// Within sentences, values may be left out or stand for others.
#[test]
fn options_within_sentences_are_there() {
    let mut count = 0;
    for (path, text) in documents() {
        let prose = blocks(&text, "sh").1;
        for code in prose.split('`').skip(1).step_by(2) {
            let words: Vec<&str> = code.split_whitespace().collect();
            let subcommand = match words[..] {
                ["pinspot", name, ..] if !name.starts_with('-') => Some(name),
                [first, ..] if first.starts_with("--") && first != "--" => None,
                _ => continue,
            };
            assert!(
                subcommand.is_none_or(|name| Cli::command().find_subcommand(name).is_some()),
                "{}: `{code}`",
                path.display()
            );
            for option in words.iter().filter(|word| word.starts_with("--") && !OPTIONS_OF_OTHERS.contains(word)) {
                count += 1;
                assert!(has_option(subcommand, option), "{}: {option} in `{code}`", path.display());
            }
        }
    }
    assert!(count > 100, "{count} options");
}

/// `src/lib.rs` has the README's snippets compiled.
#[test]
fn snippets_of_rust_are_in_the_readme() {
    for (path, text) in documents() {
        let is_compiled = path.ends_with("README.md") && path.parent() == Some(Path::new(env!("CARGO_MANIFEST_DIR")));
        assert!(
            is_compiled || blocks(&text, "rust").0.is_empty(),
            "{} has a snippet that no test compiles",
            path.display()
        );
    }
}
