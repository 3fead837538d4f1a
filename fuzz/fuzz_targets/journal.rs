//! A journal of arbitrary bytes: the records before the first damage are read, and an opened journal keeps them.
#![no_main]

use libfuzzer_sys::fuzz_target;
use palpate_data::dataset::{Journal, JournalRecords, Record};

fuzz_target!(|bytes: &[u8]| {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("journal.log");
    std::fs::write(&path, bytes).expect("a file");
    let count = || Journal::<Record>::records(&path).map_or(0, |records| records.take_while(Result::is_ok).count());
    let sound = count();
    let mut read = 0;
    let records = Journal::<Record>::read(&path, |_, _| {
        read += 1;
        Ok(())
    });
    if records.and_then(JournalRecords::go_on).is_ok() {
        assert_eq!((read, count()), (sound, sound));
    }
});
