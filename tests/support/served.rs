use super::{Live, TestFolder};
use std::collections::BTreeMap;

/// A rig's emulators that are served.
pub struct ServedProgram {
    listens: BTreeMap<String, String>,
    _bench: TestFolder,
    _emulators: Live,
}

impl ServedProgram {
    /// With additional options of `palpate emulate`.
    pub fn new(rig: &str, words: &str) -> ServedProgram {
        let bench = TestFolder::with([("rig.toml", rig)]);
        let emulators = Live::start(bench.command(&format!("emulate rig.toml --json {words}")));
        let mut listens = BTreeMap::new();
        for _ in 0..3 {
            let line = emulators.line().expect("a line a device");
            let output: serde_json::Value = serde_json::from_str(&line).expect("one JSON object a line");
            let text = |key: &str| output[key].as_str().unwrap_or_default().to_owned();
            listens.insert(text("device"), text("listen"));
        }
        ServedProgram { listens, _bench: bench, _emulators: emulators }
    }

    /// A path such as `/dev/pts/4`, or `127.0.0.1:port`.
    pub fn address(&self, device: &str) -> &str {
        &self.listens[device]
    }

    pub fn host_and_port(&self, device: &str) -> [&str; 2] {
        self.address(device).rsplit_once(':').expect("a TCP address").into()
    }
}
