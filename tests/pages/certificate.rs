//! `palpate certificate`: its files are valid, have the numbers of `evaluate`, and name their journals.

use palpate_testing::certified::bench;
use palpate_testing::exchanged;

#[test]
fn certificate_names_owner_and_evidence() {
    let bench = bench();
    let output = bench.palpate_ends(0, "certificate run --with c.toml").out;
    assert!(output.starts_with("certificate LAB-2026-0042 of sensor A-7: accepted, "), "{output}");
    assert!(output.lines().all(|line| line.chars().count() <= 80), "{output}");
    let html = bench.read("run/certificate.html");
    for part in [
        "D&lt;1&gt;&amp;co",
        "certificate K-1 of 2026-05-04",
        "certificate S-1",
        "Pass",
        "certifies no sensor",
        "not signed",
    ] {
        assert!(html.contains(part), "{part}");
    }
}

#[test]
fn certificate_states_the_verdict_or_no_statement() {
    let bench = bench();
    bench.write("strict.toml", "method = \"surrogate\"\nlocation_mean_mm = 0.001\n");
    bench.write("open.toml", "location_mean_mm = 5.0\ntest_presses_least = 1000\n");
    for (out, words, statement, xml) in [
        ("c", "--accept strict.toml", "Fail", "<dcc:conformity>fail</dcc:conformity>"),
        ("open", "--accept open.toml", "No statement", "judged afterwards by open.toml"),
    ] {
        let words = format!("certificate run --with c.toml --out {out} {words}");
        bench.palpate_ends(0, &words);
        let again = bench.palpate_ends(2, &words).running();
        assert!(again.contains(&format!("{out}.html already exists")), "{again}");
        assert!(bench.read(&format!("{out}.html")).contains(&format!("<strong>{statement}</strong>")), "{words}");
        assert!(bench.read(&format!("{out}.xml")).contains(xml), "{words}");
    }
    assert!(!bench.read("open.xml").contains("<dcc:conformity>"));
}

#[test]
fn certificate_names_the_hashes_of_its_journals() {
    let bench = bench();
    bench.palpate_ends(0, "certificate run --with c.toml");
    for file in ["run/certificate.xml", "run/certificate.html"] {
        let output = bench.palpate_ends(0, &format!("verify run --certificate {file}")).out;
        assert!(output.contains(&format!("{file} states the SHA-256 of this journal\n")), "{output}");
    }
    bench.palpate_ends(0, "run r.toml --rig rig.toml --out other --seed 2 --sensor A-8");
    let output = bench.palpate_ends(1, "verify other --certificate run/certificate.xml").running();
    assert!(output.contains("doesn't match the journal of other"), "{output}");
    bench.write("hash.xml", &format!("<!-- {} -->", bench.manifest("run")["seed"]));
    bench.palpate_ends(2, "verify run --certificate hash.xml");
    let output = bench.palpate_ends(2, "verify run --certificate rig.toml").running();
    assert!(output.contains("states no SHA-256 of a journal"), "{output}");
}

#[test]
fn certificate_without_required_data_is_not_written() {
    let bench = bench();
    let given = bench.read("c.toml");
    let refused = |text: &str, runs: &str| {
        bench.write("other.toml", text);
        let output = bench.palpate_ends(2, &format!("certificate {runs} --with other.toml --out out")).running();
        assert!(!bench.has("out.html") && !bench.has("out.xml"), "{output}");
        output
    };
    let output = refused(&exchanged(&given, "country = \"DK\"", "country = \"Denmark\""), "run");
    assert!(output.contains("expected two upper-case letters"), "{output}");
    let output = refused(&given.replace("[procedure]", "[procedur]"), "run");
    assert!(output.contains("unknown key `procedur`") && output.contains("did you mean `procedure`?"), "{output}");
    let without =
        given.split("[[responsible]]").next().unwrap().to_owned() + "[item]" + given.split("[item]").nth(1).unwrap();
    assert!(refused(&without, "run").contains("`responsible` is missing"));
    bench.palpate_ends(0, "run r.toml --rig rig.toml --out unnamed");
    assert!(refused(&given, "unnamed").contains("unnamed has no sensor ID"));
    bench.write("out.xml", "mine");
    let output = bench.palpate_ends(2, "certificate run --with c.toml --out out").running();
    assert!(
        output.contains("out.xml already exists") && bench.read("out.xml") == "mine" && !bench.has("out.html"),
        "{output}"
    );
}
