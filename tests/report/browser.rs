//! A page in headless Chromium, driven through the Chrome DevTools Protocol. Of the page it knows only that `data-error` on its
//! root element reports a failure.
//!
//! The few methods of the protocol that are needed are called directly; client libraries bring generated bindings for all of it.

use std::cell::{Cell, RefCell};
use std::io::{BufRead, BufReader};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use tempfile::TempDir;
use tungstenite::{Message, WebSocket};

/// The longest wait for an answer, or for a condition to hold.
const TIMEOUT: Duration = Duration::from_mins(1);

/// Chromium itself, with a profile of its own; both are gone when it is dropped.
struct Browser {
    process: Child,
    _profile: TempDir,
}

impl Browser {
    /// Starts it and returns the address of its socket.
    fn start() -> (Self, String) {
        let profile = tempfile::tempdir().unwrap();
        let mut process = Command::new(program())
            .args(["--headless=new", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-dev-shm-usage"])
            .args(["--window-size=1400,1000", "--remote-debugging-port=0"])
            .arg(format!("--user-data-dir={}", profile.path().display()))
            .arg("about:blank")
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut said = BufReader::new(process.stderr.take().unwrap()).lines();
        let mut heard = Vec::new();
        let address = said.by_ref().map_while(Result::ok).find_map(|line| {
            let address = line.strip_prefix("DevTools listening on ").map(str::to_owned);
            heard.push(line);
            address
        });
        let address = address.unwrap_or_else(|| panic!("Chromium did not start:\n{}", heard.join("\n")));
        // Its output is read on, or Chromium would block on a full pipe.
        std::thread::spawn(move || said.map_while(Result::ok).for_each(drop));
        (Self { process, _profile: profile }, address)
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// Chromium's executable: `CHROME`, or one of its usual names on the path.
fn program() -> PathBuf {
    let find = |name: &str| {
        std::env::split_paths(&std::env::var_os("PATH")?).map(|folder| folder.join(name)).find(|path| path.is_file())
    };
    std::env::var_os("CHROME")
        .map(PathBuf::from)
        .or_else(|| ["chromium", "chromium-browser", "google-chrome"].into_iter().find_map(find))
        .expect("the report is tested in Chromium; run by tests/run, which installs it, or set CHROME")
}

/// A page, and everything that it complained about.
pub struct Page {
    socket: RefCell<WebSocket<TcpStream>>,
    session: String,
    last_id: Cell<u64>,
    complaints: RefCell<Vec<String>>,
    _browser: Browser,
}

impl Page {
    /// Opens a file and returns once it is loaded.
    pub fn open(path: &Path) -> Self {
        let (browser, address) = Browser::start();
        let host = address.strip_prefix("ws://").and_then(|a| a.split('/').next()).unwrap();
        let stream = TcpStream::connect(host).unwrap();
        stream.set_read_timeout(Some(TIMEOUT)).unwrap();
        let (socket, _) = tungstenite::client(&address, stream).unwrap();
        let mut page = Self {
            socket: RefCell::new(socket),
            session: String::new(),
            last_id: Cell::new(0),
            complaints: RefCell::default(),
            _browser: browser,
        };
        let target = page.call("Target.createTarget", &json!({ "url": "about:blank" }))["targetId"].clone();
        let attached = page.call("Target.attachToTarget", &json!({ "targetId": target, "flatten": true }));
        attached["sessionId"].as_str().unwrap().clone_into(&mut page.session);
        for domain in ["Runtime", "Log", "Page"] {
            page.call(&format!("{domain}.enable"), &json!({}));
        }
        page.call("Page.navigate", &json!({ "url": format!("file://{}", path.display()) }));
        page.wait_for_message(|message| message["method"] == "Page.loadEventFired");
        page
    }

    /// Calls a method of the protocol and returns its result.
    fn call(&self, method: &str, params: &Value) -> Value {
        self.last_id.set(self.last_id.get() + 1);
        let mut message = json!({ "id": self.last_id.get(), "method": method, "params": params });
        if !self.session.is_empty() {
            message["sessionId"] = self.session.clone().into();
        }
        self.socket.borrow_mut().send(Message::text(message.to_string())).unwrap();
        let mut answer = self.wait_for_message(|message| message["id"] == self.last_id.get());
        assert!(answer["error"].is_null(), "{method}: {}", answer["error"]);
        answer["result"].take()
    }

    /// Reads messages until the one that is wanted; records the complaints among them.
    fn wait_for_message(&self, is_wanted: impl Fn(&Value) -> bool) -> Value {
        loop {
            let Message::Text(text) = self.socket.borrow_mut().read().expect("an answer from Chromium") else {
                continue;
            };
            let message: Value = serde_json::from_str(&text).unwrap();
            let params = &message["params"];
            let complaint = match message["method"].as_str() {
                Some("Runtime.exceptionThrown") => Some(&params["exceptionDetails"]),
                Some("Runtime.consoleAPICalled") => Some(&params["args"]),
                Some("Log.entryAdded") => Some(&params["entry"]["text"]),
                _ => None,
            };
            self.complaints.borrow_mut().extend(complaint.map(ToString::to_string));
            if is_wanted(&message) {
                return message;
            }
        }
    }

    /// Exceptions, and what was written to the console or the log, so far.
    pub fn complaints(&self) -> Vec<String> {
        self.complaints.borrow().clone()
    }

    /// The value of an expression; of a promise, the value that it resolves to.
    pub fn evaluate(&self, script: &str) -> Value {
        let params = json!({ "expression": script, "returnByValue": true, "awaitPromise": true });
        let mut answer = self.call("Runtime.evaluate", &params);
        assert!(answer["exceptionDetails"].is_null(), "{script}: {}", answer["exceptionDetails"]);
        answer["result"]["value"].take()
    }

    /// The text that an expression returns; empty if it returns something else.
    pub fn text(&self, script: &str) -> String {
        self.evaluate(script).as_str().unwrap_or_default().to_owned()
    }

    /// Waits until a condition holds.
    pub fn wait_for(&self, condition: &str) {
        let start = Instant::now();
        while self.evaluate(condition) != Value::Bool(true) {
            let error = self.text("document.documentElement.dataset.error || ''");
            assert!(error.is_empty(), "the page failed: {error}");
            assert!(start.elapsed() < TIMEOUT, "never true: {condition}");
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Returns when all that was asked of the page before has been drawn: two frames later.
    pub fn settle(&self) {
        self.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done(true))))");
    }
}
