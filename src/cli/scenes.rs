//! `pinspot scenes`.

use clap::Args;

use pinspot::low_level::environment::BUILT_IN_MAPS;
use pinspot::scene::BUILT_IN;

use super::console::{Console, Failure};

#[derive(Debug, Args)]
pub struct ScenesArgs {
    /// Print the file of a built-in scene, as a starting point for your own
    #[arg(long, value_name = "NAME")]
    show: Option<String>,
}

pub fn run(args: &ScenesArgs, console: &Console) -> Result<(), Failure> {
    if let Some(name) = &args.show {
        let scene = BUILT_IN.iter().find(|s| s.name == name);
        let scene = scene.ok_or_else(|| format!("there is no built-in scene '{name}'; `pinspot scenes` lists them"))?;
        return console.print(scene.toml.trim_end());
    }
    let mut lines = vec!["Scenes:".to_owned()];
    lines.extend(BUILT_IN.iter().map(|s| format!("  {:16} {}", s.name, s.about)));
    lines.push("Environment maps:".to_owned());
    lines.extend(BUILT_IN_MAPS.iter().map(|m| format!("  {:16} {}", m.name, m.about)));
    console.print(&lines.join("\n"))
}
