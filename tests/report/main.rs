//! The HTML report in a real browser: headless Chromium opens, flips and sorts it.

use std::path::Path;
use std::process::Command;

use browser::Page;

mod browser;

fn compare(folder: &Path) -> Vec<u8> {
    let more = ["--strategies", "random,neighbourhood", "--samples", "20,80", "--seeds", "2", "--size", "48x32"];
    let output = Command::new(env!("CARGO_BIN_EXE_pinspot"))
        .args(["compare", "mirror-sphere", "-o"])
        .arg(folder)
        .args(more)
        .args(["--rel-error", "0.05", "--backend", "cpu", "--json"])
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    output.stdout
}

/// A canvas as a number that differs where its pixels do.
fn canvas(name: &str) -> String {
    format!(
        "(() => {{ const c = document.getElementById('{name}'); \
         const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data; \
         let h = 0; for (const v of d) h = (31 * h + v) | 0; return h; }})()"
    )
}

impl Page {
    /// Sets a control as a user would, and waits until `what` is another than before.
    fn set_and_see(&self, control: &str, value: &str, event: &str, what: &str) {
        let before = self.evaluate(what);
        self.evaluate(&format!(
            "(() => {{ const c = document.getElementById('{control}'); c.value = '{value}'; \
             c.dispatchEvent(new Event('{event}', {{ bubbles: true }})); }})()"
        ));
        self.wait_for(&format!("JSON.stringify({what}) !== {:?}", before.to_string()));
    }

    fn click_and_see(&self, control: &str, what: &str) {
        let before = self.evaluate(what);
        self.evaluate(&format!(
            "document.querySelector('{control}').dispatchEvent(new Event('click', {{ bubbles: true }}))"
        ));
        self.wait_for(&format!("JSON.stringify({what}) !== {:?}", before.to_string()));
    }
}

/// A click on a row shows its image as B and marks the row.
fn sorted_rows_show_their_image(page: &Page) {
    page.click_and_see("#results tbody tr:first-child", "document.querySelector('#results tr.current').dataset.image");
    page.wait_for("document.querySelector('#results tbody tr:first-child').classList.contains('current')");
    page.wait_for(
        "document.getElementById('select-b').value === document.querySelector('#results tr.current').dataset.image",
    );
    page.click_and_see("#thumbs button:nth-child(3)", "document.getElementById('select-b').value");
    assert_eq!(page.text("document.getElementById('select-b').value"), "2");
}

fn controls_change_the_images(page: &Page) {
    page.set_and_see("layout", "side", "change", "document.getElementById('canvas-b').closest('figure').hidden");
    page.set_and_see("exposure", "4", "input", &canvas("canvas-a"));
    page.wait_for("document.getElementById('exposure-value').textContent === '+4.00 EV'");
    // The difference is shown from the start. Each heat map has colours and a caption of its own; none hides it.
    let caption = "document.querySelector('figure[data-view=heat] .caption').textContent";
    let mut captions = vec![page.text(caption)];
    for heat in ["flip", "signed"] {
        page.set_and_see("heat", heat, "change", caption);
        captions.push(page.text(caption));
    }
    page.set_and_see("heat", "difference", "change", &canvas("canvas-heat"));
    captions.sort();
    captions.dedup();
    assert!(captions.len() == 3 && captions.iter().all(|c| !c.is_empty()), "{captions:?}");
    let is_hidden = "document.getElementById('canvas-heat').closest('figure').hidden";
    page.set_and_see("heat", "none", "change", is_hidden);
    assert_eq!(page.evaluate(is_hidden), true);
    // Sample points are drawn over B, and taken away again.
    let plain = page.evaluate(&canvas("canvas-b"));
    let dots = |on: bool| {
        page.evaluate("document.getElementById('dots').click()");
        page.wait_for(&format!("({} === {plain}) !== {on}", canvas("canvas-b")));
    };
    dots(true);
    dots(false);
}

/// Another metric and another cost are other curves; a click on a legend entry hides its series, another shows it.
fn plots_follow_their_choices(page: &Page) {
    let curves =
        |plot: &str| format!("[...document.querySelectorAll('#{plot} .curve')].map(c => c.getAttribute('d')).join()");
    // The legend's samples of the lines are no curves of the plot.
    let count = "document.querySelectorAll('#plot-samples .curve:not(.entry .curve)').length";
    assert_eq!(page.evaluate(count), 4);
    page.set_and_see("metric", "flip", "change", &curves("plot-samples"));
    page.set_and_see("cost", "lookups", "change", &curves("plot-cost"));
    for expected in [3, 4] {
        page.click_and_see("#plot-samples .entry", count);
        assert_eq!(page.evaluate(count), expected);
    }
}

fn rows_are_filtered_by_words(page: &Page) {
    let visible = "document.querySelectorAll('#results tbody tr:not([hidden])').length";
    page.set_and_see("filter", "random none", "input", visible);
    assert_eq!(page.evaluate(visible), 4);
    assert_eq!(page.text("document.getElementById('count').textContent"), "4 of 16 rows");
    page.set_and_see("filter", "", "input", visible);
    assert_eq!(page.evaluate(visible), 16);
}

const ERRORS: &str = "JSON.stringify([...document.querySelectorAll('#results tbody td[data-key=\"rel_l2\"]')].map(td => +td.textContent))";

fn errors(page: &Page) -> Vec<f64> {
    serde_json::from_str(&page.text(ERRORS)).unwrap()
}

#[test]
fn the_report_opens_flips_and_sorts() {
    let folder = tempfile::tempdir().unwrap();
    compare(folder.path());
    let path = folder.path().join("report.html");
    let source = std::fs::read_to_string(&path).unwrap();
    for attribute in ["src=\"", "href=\"", "src='", "href='"] {
        for (_, rest) in source.match_indices(attribute).map(|(at, _)| source[at..].split_at(attribute.len())) {
            assert!(rest.starts_with("data:") || rest.starts_with('#'), "{attribute}{}", &rest[..40.min(rest.len())]);
        }
    }
    let page = Page::open(&path);
    page.wait_for("document.documentElement.dataset.ready === 'true'");
    // Flip between reference and picture, by the button and by the key.
    assert_eq!(page.text("document.getElementById('shown').textContent"), "A: reference");
    page.evaluate("document.getElementById('flip-button').click()");
    page.wait_for("document.getElementById('shown').textContent.startsWith('B: ')");
    page.evaluate("document.dispatchEvent(new KeyboardEvent('keydown', { key: 'f', bubbles: true }))");
    page.wait_for("document.getElementById('shown').textContent === 'A: reference'");
    // Two strategies × two filters × two counts × two seeds; sorting by error, both ways.
    let given = errors(&page);
    assert_eq!(given.len(), 16);
    page.evaluate("document.querySelector('#results th[data-key=\"rel_l2\"]').click()");
    let once = errors(&page);
    page.evaluate("document.querySelector('#results th[data-key=\"rel_l2\"]').click()");
    let twice = errors(&page);
    let mut sorted = given;
    sorted.sort_by(f64::total_cmp);
    let mut reversed = sorted.clone();
    reversed.reverse();
    assert!(once == sorted && twice == reversed || once == reversed && twice == sorted, "{once:?} {twice:?}");
    sorted_rows_show_their_image(&page);
    controls_change_the_images(&page);
    plots_follow_their_choices(&page);
    rows_are_filtered_by_words(&page);
    page.wait_for("!document.getElementById('sampling').hidden");
    let links = page.text("JSON.stringify([...document.querySelectorAll('[src],[href]')].flatMap(n => [n.getAttribute('src'), n.getAttribute('href')]).filter(v => v !== null && !/^(data:|#)/.test(v)))");
    assert_eq!(links, "[]");
    page.settle();
    page.evaluate("console.info('this is heard')");
    let (heard, complaints): (Vec<String>, Vec<String>) =
        page.complaints().into_iter().partition(|c| c.contains("this is heard"));
    assert_eq!(heard.len(), 1);
    // Chromium remarks on the test's own reading of the canvas.
    let own: Vec<&String> = complaints.iter().filter(|c| !c.contains("willReadFrequently")).collect();
    assert!(own.is_empty(), "{own:?}");
}

#[test]
fn a_comparison_goes_on_where_it_was_interrupted() {
    let folder = tempfile::tempdir().unwrap();
    let first = compare(folder.path());
    let report: serde_json::Value = serde_json::from_slice(&first).unwrap();
    let rows = report["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 16);
    for key in [
        "technique",
        "strategy",
        "filter",
        "samples",
        "taps",
        "visibility",
        "rel_l2",
        "mrse",
        "flip",
        "seconds",
        "lookups",
    ] {
        assert!(!rows[0][key].is_null(), "{key}");
    }
    assert!(report["reference"]["rel_error"].as_f64().unwrap() <= 0.05);
    let csv = std::fs::read_to_string(folder.path().join("report.csv")).unwrap();
    assert_eq!(csv.lines().count(), 17);
    // What is there is used again, with the seconds that it took then; what is lost or damaged is made again.
    let cell = |k: usize| folder.path().join(rows[k]["file"].as_str().unwrap());
    let kept = std::fs::metadata(cell(5)).unwrap().modified().unwrap();
    std::fs::remove_file(cell(0)).unwrap();
    std::fs::write(cell(1), "half a fi").unwrap();
    std::fs::remove_file(folder.path().join("report.html")).unwrap();
    let again: serde_json::Value = serde_json::from_slice(&compare(folder.path())).unwrap();
    assert_eq!(std::fs::metadata(cell(5)).unwrap().modified().unwrap(), kept);
    assert_eq!(again["rows"][5], rows[5]);
    for k in 0..16 {
        assert_eq!(again["rows"][k]["rel_l2"], rows[k]["rel_l2"], "the same bits");
    }
    assert!(cell(0).exists() && folder.path().join("report.html").exists());
}
