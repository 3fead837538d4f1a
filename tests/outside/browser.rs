//! Pages in a real browser without a screen: no errors, no text is cut or covers another, and every figure shows something, on a desk and
//! on a telephone.
//!
//! The screenshots stay in the folder that is printed, for a person.

use palpate_testing::batches::{self, Drawn, MONTH};
use palpate_testing::skins::skins;
use palpate_testing::{SMALL, TestFolder, campaign, exchanged, shipped, shipped_text};
use serde_json::Value;
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Widths of the window, px: a desk and a telephone.
const WIDTHS: [u32; 2] = [1280, 390];
/// A rule with values that can't all be judged.
const GUARDED: &str = "\
rule = \"guarded\"
location_mean_mm = 1.0
location_p95_mm = 1.5
force_mean_n = 0.1
";
/// Height of a first screen at the first of these widths, px.
const FIRST_SCREEN_PX: u64 = 800;
/// Browsers with the same options, by name.
const BROWSERS: [&str; 4] = ["chromium", "chromium-browser", "google-chrome", "chrome"];
/// The script that checks a page.
const LOOK: &str = include_str!("browser/look.js");

#[test]
#[ignore = "needs Chromium"]
fn pages_are_complete_on_a_desk_and_on_a_telephone() {
    let browser = Browser::find();
    let bench = TestFolder::new();
    let paper = shipped("recipes/paper.toml");
    bench.palpate_ends(0, &format!("run {} --out paper", paper.display()));
    bench.palpate_ends(0, "report paper --out paper.html");
    bench.write("guarded.toml", GUARDED);
    bench.palpate_ends(1, "report paper --accept guarded.toml --out guarded.html");
    for seed in 1..=12 {
        bench.write("small.toml", SMALL);
        let sensor =
            if seed == 3 { "a-sensor-of-a-batch-with-a-long-name-0003".to_owned() } else { format!("A-{seed}") };
        bench.palpate(&format!("run small.toml --seed {seed} --sensor {sensor} --out s{seed}"));
    }
    bench.palpate_ends(0, "report s3 --out small.html");
    let runs: String = (1..=12).map(|seed| format!(" s{seed}")).collect();
    bench.palpate_ends(0, &format!("report --compare{runs} paper --out batch.html"));
    let soft = exchanged(&shipped_text("rigs/sim.toml"), "linear_n_mm = 1.1", "linear_n_mm = 0.2");
    bench.write("soft.toml", &soft);
    bench.palpate_ends(4, "run small.toml --rig soft.toml --out tripped");
    bench.palpate_ends(0, "report tripped --out tripped.html");
    let skins = skins();
    for skin in ["magnetic", "fifteen"] {
        skins.palpate_ends(0, &format!("report {skin} --out {skin}.html"));
        bench.write(&format!("{skin}.html"), &skins.read(&format!("{skin}.html")));
    }
    batches::write(&bench.path("june"), &MONTH, &shipped_text("rigs/batch.toml"));
    let july = Drawn { name: "july", sensors: 500, drift: 0.0, seed: 2, ..MONTH };
    batches::write(&bench.path("july"), &july, &shipped_text("rigs/batch.toml"));
    bench.palpate_ends(0, "batch report june --out june.html");
    bench.palpate_ends(0, "batch report july --out july.html");
    bench.palpate_ends(0, "batch report --compare june july --out months.html");

    let mut wrong: Vec<String> = Vec::new();
    let pages = ["paper", "magnetic", "guarded", "fifteen", "small", "batch", "tripped", "june", "july", "months"];
    let pictured = campaign::size(1, pages.len());
    for (nth, page) in pages.into_iter().enumerate() {
        let path = bench.path(&format!("{page}.html"));
        for width in WIDTHS {
            let seen = browser.look(&path, width);
            assert_eq!(seen.width, u64::from(width), "{page}: the window");
            assert!(seen.texts > 20, "{page} at {width}: {} texts", seen.texts);
            if ["paper", "magnetic", "fifteen", "small", "guarded"].contains(&page) {
                assert!(
                    seen.first > 0 && (width < 1000 || page == "guarded" || seen.first <= FIRST_SCREEN_PX),
                    "{page}: {} px",
                    seen.first
                );
                assert!(seen.scrolled.is_empty(), "{page} at {width} px: {:?}", seen.scrolled);
                println!("{page} at {width} px: errors and places end at {} px", seen.first);
            }
            let found = seen.problems.iter().chain(&seen.console);
            wrong.extend(found.map(|problem| format!("{page} at {width} px: {problem}")));
            if nth >= pictured {
                continue;
            }
            let [light, dark] = [false, true].map(|is_dark| {
                let name = format!("{page}-{width}{}", if is_dark { "-dark" } else { "" });
                browser.photograph(&path, &name, (width, seen.height), is_dark)
            });
            assert!(light != dark, "{page} at {width}: dark is as light");
        }
        if nth < pictured {
            browser.print(&path, page);
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    println!("screenshots: {}", browser.album.display());
}

#[test]
#[ignore = "needs Chromium"]
fn figures_of_the_studies_have_room_for_their_words() {
    let browser = Browser::find();
    let bench = TestFolder::new();
    for study in ["curves", "budget --quick", "failures --quick", "speed-accuracy --quick", "minutes --quick"] {
        bench.palpate_ends(0, &format!("study {study} --out {}", study.split(' ').next().expect("a name")));
    }
    let rig = shipped("rigs/sim.toml");
    bench.palpate_ends(0, &format!("study curves --rig {} --out array", rig.display()));
    let mut wrong: Vec<String> = Vec::new();
    let mut figures = 0;
    for study in ["curves", "array", "budget", "failures", "speed-accuracy", "minutes"] {
        for (name, svg) in bench.bytes(study).into_iter().filter(|(name, _)| name.ends_with(".svg")) {
            let svg = String::from_utf8(svg).expect("an SVG is text");
            let page = format!("<!DOCTYPE html><html><body style=\"margin:0\"><figure>{svg}</figure></body></html>");
            bench.write("figure.html", &page);
            let seen = browser.look(&bench.path("figure.html"), 1400);
            assert!(seen.texts > 5, "{study}/{name}");
            wrong.extend(seen.problems.iter().map(|problem| format!("{study}/{name}: {problem}")));
            figures += 1;
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(figures >= 10, "{figures} figures");
}

/// A page with one label on top of another, and with one that is too small: both are found.
#[test]
#[ignore = "needs Chromium"]
fn page_with_overlapping_labels_is_detected() {
    let browser = Browser::find();
    let bench = skins();
    bench.palpate_ends(0, "report fifteen --out page.html");
    let page = bench.read("page.html");
    let problems = |text: &str| {
        bench.write("twin.html", text);
        browser.look(&bench.path("twin.html"), 1280).problems
    };
    assert_eq!(problems(&page), Vec::<String>::new());
    let places = |label: &str| {
        let (before, _) = page.split_once(&format!(">{label}</text>")).expect("a label");
        before.rsplit_once("<text ").expect("an element").1.to_owned()
    };
    let moved = exchanged(&page, &format!("{}>unit 1<", places("unit 1")), &format!("{}>unit 1<", places("unit 2")));
    let found = problems(&moved);
    let is_of_both = |problem: &String| problem.contains("\"unit 1\"") && problem.contains("\"unit 2\"");
    assert!(found.iter().any(|problem| problem.starts_with("over each other") && is_of_both(problem)), "{found:?}");
    let small = exchanged(&page, ".word{font-size:11.5px}", ".word{font-size:6px}");
    let found = problems(&small);
    assert!(found.iter().any(|problem| problem.starts_with("too small, ")), "{found:?}");
}

/// The script finds the errors that it is for.
#[test]
#[ignore = "needs Chromium"]
fn page_with_faults_is_detected() {
    let browser = Browser::find();
    let faulty = |body: &str| {
        let bench =
            TestFolder::with([("page.html", format!("<!DOCTYPE html><html><body>{body}</body></html>").as_str())]);
        browser.look(&bench.path("page.html"), 390)
    };
    let svg = |inside: &str| format!("<figure><svg width=\"200\" viewBox=\"0 0 200 50\">{inside}</svg></figure>");
    for (body, problem) in [
        ("<div style=\"width:900px\">wide</div>".to_owned(), "the page is"),
        (svg("<path d=\"M0 0L9 9\"/><text x=\"190\" y=\"30\">beyond the edge</text>"), "cut: \"beyond the edge\""),
        (
            svg("<path d=\"M0 0L9 9\"/><text x=\"9\" y=\"30\">one</text><text x=\"12\" y=\"32\">two</text>"),
            "over each other: \"one\"",
        ),
        (svg("<path d=\"M0 0L9 9\"/><text x=\"9\" y=\"30\" style=\"font-size:6px\">small</text>"), "too small, 6.0 px"),
        (svg("<path d=\"M0 0\"/>"), "1 figures show nothing"),
    ] {
        let seen = faulty(&body);
        assert!(seen.problems.iter().any(|found| found.contains(problem)), "{problem}: {:?}", seen.problems);
    }
    let seen = faulty("<p>one line</p><script>console.error('a complaint')</script>");
    assert!(seen.problems.is_empty() && seen.console.iter().any(|line| line.contains("a complaint")), "{seen:?}");
}

/// A browser without a screen.
struct Browser {
    program: PathBuf,
    album: PathBuf,
}

/// Result of a page.
#[derive(Debug)]
struct BrowserSeen {
    width: u64,
    height: u64,
    texts: u64,
    /// Lower end of the errors and the places, px.
    first: u64,
    /// Beginnings of the parts with a table that scrolls sideways.
    scrolled: Vec<String>,
    problems: Vec<String>,
    console: Vec<String>,
}

impl Browser {
    /// The browser named by `PALPATE_BROWSER`, or the first on the path.
    fn find() -> Browser {
        let path = std::env::var_os("PATH").unwrap_or_default();
        let named = std::env::var_os("PALPATE_BROWSER").map(PathBuf::from);
        let on_path = BROWSERS.iter().flat_map(|name| std::env::split_paths(&path).map(move |at| at.join(name)));
        let found = named.or_else(|| on_path.into_iter().find(|program| program.is_file()));
        let program = found.unwrap_or_else(|| {
            panic!("there is no browser ({}): install chromium, or name one by PALPATE_BROWSER", BROWSERS.join(", "))
        });
        let album = Path::new(env!("CARGO_TARGET_TMPDIR")).join("pages");
        fs::create_dir_all(&album).expect("a folder for screenshots");
        Browser { program, album }
    }

    /// Opens a page with the script in a frame of that width, because a window has a least width.
    fn look(&self, page: &Path, width: u32) -> BrowserSeen {
        let text = fs::read_to_string(page).expect("a page");
        let (watched, framed) = (page.with_extension("watched.html"), page.with_extension("framed.html"));
        let end = text.rfind("</body>").expect("a page has a body");
        fs::write(&watched, format!("{}<script>{LOOK}</script>{}", &text[..end], &text[end..])).expect("a page");
        let name = watched.file_name().expect("a name").to_string_lossy();
        let frame = format!(
            "<!DOCTYPE html><body style=\"margin:0\"><script>addEventListener('message', (event) => {{\
             const pre = document.createElement('pre'); pre.id = 'looked'; pre.textContent = event.data;\
             document.body.append(pre); }})</script>\
             <iframe src=\"{name}\" style=\"border:0;width:{width}px;height:2000px\"></iframe></body>"
        );
        fs::write(&framed, frame).expect("a page");
        let (out, err) = self.run(&framed, (1280, 2000), &["--dump-dom".into()]);
        let looked = out.split("<pre id=\"looked\">").nth(1).and_then(|rest| rest.split("</pre>").next());
        let looked = looked.unwrap_or_else(|| panic!("the page wasn't looked at:\n{err}"));
        let looked = looked.replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&");
        let looked: Value = serde_json::from_str(&looked).unwrap_or_else(|error| panic!("{error}: {looked}"));
        let list = |key: &str| -> Vec<String> {
            let items = looked[key].as_array().expect("a list");
            items.iter().map(|item| item.as_str().unwrap_or_default().to_owned()).collect()
        };
        BrowserSeen {
            width: looked["width"].as_u64().expect("a width"),
            height: looked["height"].as_u64().expect("a height"),
            texts: looked["texts"].as_u64().expect("a count"),
            first: looked["first"].as_u64().expect("a height"),
            scrolled: list("scrolled"),
            problems: list("problems"),
            console: err.lines().filter(|line| line.contains(":CONSOLE")).map(str::to_owned).collect(),
        }
    }

    /// Prints a page on A4.
    fn print(&self, page: &Path, name: &str) {
        let printed = self.album.join(format!("{name}.pdf"));
        let mut word = OsString::from("--print-to-pdf=");
        word.push(&printed);
        self.run(page, (1280, 800), &["--no-pdf-header-footer".into(), word]);
        let bytes = fs::read(&printed).expect("a printed page");
        let text = String::from_utf8_lossy(&bytes);
        assert!(text.contains("/MediaBox [0 0 594.95") || text.contains("/MediaBox [0 0 595"), "{name}: not A4");
    }

    /// Saves a picture of a page.
    fn photograph(&self, page: &Path, name: &str, size: (u32, u64), is_dark: bool) -> Vec<u8> {
        let picture = self.album.join(format!("{name}.png"));
        let mut word = OsString::from("--screenshot=");
        word.push(&picture);
        let scheme =
            if is_dark { "--blink-settings=preferredColorScheme=0" } else { "--blink-settings=preferredColorScheme=1" };
        self.run(page, size, &[scheme.into(), word]);
        let bytes = fs::read(&picture).expect("a screenshot");
        let side =
            |at: usize| bytes.get(at..at + 4).map(|four| u32::from_be_bytes(four.try_into().expect("four bytes")));
        assert!(bytes.starts_with(b"\x89PNG") && side(16) == Some(size.0), "{name}: {} bytes", bytes.len());
        assert!(bytes.len() > 10_000, "{name}: hardly anything is in a picture of {} bytes", bytes.len());
        bytes
    }

    fn run(&self, page: &Path, (width, height): (u32, u64), what: &[OsString]) -> (String, String) {
        let profile = tempfile::tempdir().expect("a folder");
        let mut command = Command::new(&self.program);
        let words = [
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--hide-scrollbars",
            "--no-first-run",
            "--virtual-time-budget=10000",
        ];
        command.args(words).args(["--enable-logging=stderr", "--v=0"]).stdin(Stdio::null());
        command.arg(format!("--user-data-dir={}", profile.path().display()));
        command.arg(format!("--window-size={width},{height}")).args(what).arg(format!("file://{}", page.display()));
        let output = command.output().expect("the browser starts");
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        (text(&output.stdout), text(&output.stderr))
    }
}
