//! What users wait for: whole runs of the program on one thread, as tables for `docs/performance.md`: `cargo bench --bench pictures`.
//!
//! `PINSPOT_BASE=another/pinspot` names the program of another version to compare with: runs of the two alternate. Seconds vary with
//! what else the machine does; ratios within a run mean something. Arguments choose tables: `-- pictures visibility growth drafts`.

use std::env;
use std::error::Error;
use std::path::Path;
use std::process::Command;
use std::time::Instant;

use serde_json::Value;

/// The scenes of the tables.
const SCENES: [&str; 4] = ["ring-natural", "cup", "spoon", "columns"];
/// Runs of each program; the fastest counts.
const RUNS: usize = 2;

/// What one run took, in seconds.
struct Seconds {
    /// From its start to its end.
    wall: f64,
    /// Stage by stage, from its report.
    stages: Value,
}

impl Seconds {
    fn of(program: &Path, arguments: &[&str]) -> Result<Self, Box<dyn Error>> {
        let output = tempfile::Builder::new().suffix(".exr").tempfile()?;
        let start = Instant::now();
        let run = Command::new(program)
            .arg("render")
            .args(arguments)
            .args(["--backend", "cpu", "--json", "--quiet", "-o"])
            .arg(output.path())
            .env("RAYON_NUM_THREADS", "1")
            .output()?;
        let wall = start.elapsed().as_secs_f64();
        if !run.status.success() {
            return Err(format!("{} {arguments:?}: {}", program.display(), String::from_utf8_lossy(&run.stderr)).into());
        }
        Ok(Self { wall, stages: serde_json::from_slice::<Value>(&run.stdout)?["seconds"].take() })
    }

    /// Of a stage that every run has.
    fn of_stage(&self, name: &str) -> Result<f64, String> {
        self.stages[name].as_f64().ok_or_else(|| format!("the report has no stage '{name}'"))
    }
}

/// The fastest of several alternating runs of each program.
fn fastest(programs: &[&Path], arguments: &[&str]) -> Result<Vec<f64>, Box<dyn Error>> {
    let mut best = vec![f64::INFINITY; programs.len()];
    for _ in 0..RUNS {
        for (program, best) in programs.iter().zip(&mut best) {
            *best = best.min(Seconds::of(program, arguments)?.wall);
        }
    }
    Ok(best)
}

fn default_pictures(own: &Path, base: Option<&Path>) -> Result<(), Box<dyn Error>> {
    println!(
        "\nDefault pictures, 512², everything from the scene to the file, seconds\n\n| scene | base | now | ratio |\n|---|---|---|---|"
    );
    for scene in SCENES {
        match fastest(&[Some(own), base].into_iter().flatten().collect::<Vec<_>>(), &[scene])?[..] {
            [now, before] => println!("| `{scene}` | {before:.1} | {now:.1} | {:.2} |", before / now),
            [now] => println!("| `{scene}` | | {now:.1} | |"),
            _ => unreachable!("one or two programs"),
        }
    }
    Ok(())
}

/// The gather of the caustic with visibility over that without.
fn visibility(own: &Path) -> Result<(), Box<dyn Error>> {
    println!("\nCaustic at 160², 64 leaves: the gather with visibility over that without\n");
    println!("| samples | 1,000 | 3,000 | 10,000 |\n|---|---|---|---|");
    for scene in SCENES {
        for tolerance in ["0.01", "0.05"] {
            print!("| `{scene}`, tolerance {tolerance} ");
            for samples in ["1000", "3000", "10000"] {
                let gather = |visibility: &str| {
                    let options = ["--aov", "caustic", "--size", "160x160", "--leaves", "64", "--tolerance", tolerance];
                    let rest = [scene, "--samples", samples, "--visibility", visibility];
                    Ok::<_, Box<dyn Error>>(Seconds::of(own, &[&rest[..], &options].concat())?.of_stage("caustic")?)
                };
                print!("| {:.1} ", gather("full")? / gather("none")?);
            }
            println!("|");
        }
    }
    Ok(())
}

/// How the time of a frame grows with the samples and with the pixels.
fn growth(own: &Path) -> Result<(), Box<dyn Error>> {
    println!(
        "\nGrowth, `ring-natural`, one leaf a sample\n\n| samples | tree and visibility maps, s | gather, s |\n|---|---|---|"
    );
    let mut of_counts = Vec::new();
    for samples in ["1000", "10000", "100000"] {
        let options = ["ring-natural", "--aov", "caustic", "--size", "160x160", "--leaves", "1", "--samples", samples];
        let seconds = Seconds::of(own, &options)?;
        let prepared = seconds.of_stage("tree")? + seconds.of_stage("visibility")?;
        let of_count = [prepared, seconds.of_stage("caustic")?];
        println!("| {samples} | {:.2} | {:.2} |", of_count[0], of_count[1]);
        of_counts.push(of_count);
    }
    let ratio = |k: usize| of_counts[2][k] / of_counts[0][k];
    println!("| 100,000 over 1,000 | {:.1} | {:.1} |", ratio(0), ratio(1));

    println!("\n2048² over 512² pixels:");
    let seconds = |size: &str, aov: &str| Seconds::of(own, &["ring-natural", "--aov", aov, "--size", size]);
    let [caustic, large_caustic] = [seconds("512x512", "caustic")?, seconds("2048x2048", "caustic")?];
    let [picture, large_picture] = [seconds("512x512", "beauty")?, seconds("2048x2048", "beauty")?];
    println!("- the caustic alone: {:.1}", large_caustic.of_stage("caustic")? / caustic.of_stage("caustic")?);
    let gathers = |s: &Seconds| Ok::<_, String>(s.of_stage("caustic")? + s.of_stage("path-ends")?);
    println!("- the caustic in a picture, with ends of paths: {:.1}", gathers(&large_picture)? / gathers(&picture)?);
    println!("- the picture: {:.1}", large_picture.wall / picture.wall);
    Ok(())
}

fn drafts(own: &Path) -> Result<(), Box<dyn Error>> {
    println!("\nDrafts, 512²: seconds of gathers, on one thread\n\n| scene | caustic | ends of paths |\n|---|---|---|");
    for scene in pinspot::scene::BUILT_IN {
        let seconds = Seconds::of(own, &[scene.name, "--quality", "draft", "--size", "512x512"])?;
        // Where no mirror shows a receiver, there are no ends.
        let ends = seconds.of_stage("path-ends").unwrap_or(0.0);
        println!("| `{}` | {:.2} | {ends:.2} |", scene.name, seconds.of_stage("caustic")?);
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    let own = Path::new(env!("CARGO_BIN_EXE_pinspot"));
    let base = env::var_os("PINSPOT_BASE");
    let chosen: Vec<String> = env::args().skip(1).filter(|argument| !argument.starts_with('-')).collect();
    let is_chosen = |table: &str| chosen.is_empty() || chosen.iter().any(|name| name == table);
    if is_chosen("pictures") {
        default_pictures(own, base.as_deref().map(Path::new))?;
    }
    if is_chosen("visibility") {
        visibility(own)?;
    }
    if is_chosen("growth") {
        growth(own)?;
    }
    if is_chosen("drafts") {
        drafts(own)?;
    }
    Ok(())
}
