"""Switches each wrong rule of mutants.toml on, and runs the unit tests of its crate. A rule that no test notices fails, and so does one
that isn't found in its file or doesn't compile. Usage: mutants.py TARGET_FOLDER [NUMBER ...]"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
MOST_S = 120  # a rule that never ends its tests is noticed too

SWITCH = """
/// Whether a wrong rule is switched on.
pub(crate) fn is_mutant(number: u32) -> bool {
    static ON: std::sync::OnceLock<Option<u32>> = std::sync::OnceLock::new();
    *ON.get_or_init(|| std::env::var("PALPATE_MUTANT").ok().and_then(|text| text.parse().ok())) == Some(number)
}
"""


def crate_of(mutant):
    return mutant["file"].split("/")[1]


def switched(text, mutants):
    """Returns the text of a file with a switch at each mutant."""
    spans = []
    for number, mutant in mutants:
        before, rest = mutant["code"].split("[[", 1)
        expression, after = rest.split("]]", 1)
        code = before + expression + after
        if text.count(code) != 1:
            sys.exit(f"mutants.toml: mutant {number} ({mutant['why']}): {text.count(code)} times in {mutant['file']}: {code}")
        start = text.index(code) + len(before)
        spans.append((start, start + len(expression), number, mutant["instead"]))
    for start, end, number, instead in sorted(spans, reverse=True):
        text = f"{text[:start]}match crate::is_mutant({number}) {{ true => {instead}, false => {text[start:end]} }}{text[end:]}"
    return text


def built(copy, target, crates):
    """Builds the unit tests of some crates; returns their programs."""
    programs = {}
    environment = {**os.environ, "CARGO_TARGET_DIR": str(target)}
    for crate in crates:
        command = ["cargo", "test", "--locked", "--lib", "--no-run", "--message-format", "json-render-diagnostics", "--package", f"palpate-{crate}"]
        output = subprocess.run(command, cwd=copy, env=environment, stdout=subprocess.PIPE, text=True)
        if output.returncode != 0:
            sys.exit("a mutant doesn't compile")
        messages = [json.loads(line) for line in output.stdout.splitlines()]
        programs[crate] = [message["executable"] for message in messages if message.get("executable")][-1]
    return programs


def outcome(program, folder, number):
    """Returns the tests that failed with a mutant switched on; None if all passed."""
    environment = {**os.environ, "PALPATE_MUTANT": str(number), "RUST_BACKTRACE": "0"}
    try:
        run = subprocess.run([program], cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, timeout=MOST_S)
    except subprocess.TimeoutExpired:
        return ["(no end)"]
    failed = [line.split()[1] for line in run.stdout.splitlines() if line.startswith("test ") and line.endswith("FAILED")]
    return None if run.returncode == 0 else failed or ["(aborted)"]


def main():
    target, wanted = Path(sys.argv[1]).resolve(), [int(number) for number in sys.argv[2:]]
    mutants = list(enumerate(tomllib.loads((HERE / "mutants.toml").read_text())["mutant"], 1))
    copy = Path(tempfile.mkdtemp())
    try:
        for name in subprocess.check_output(["git", "ls-files", "-z"], cwd=ROOT, text=True).split("\0"):
            if name and (ROOT / name).is_file():
                (copy / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(ROOT / name, copy / name)
        for file in {mutant["file"] for _, mutant in mutants}:
            its = [(number, mutant) for number, mutant in mutants if mutant["file"] == file]
            (copy / file).write_text(switched((copy / file).read_text(), its))
        crates = sorted({crate_of(mutant) for _, mutant in mutants})
        for crate in crates:
            with (copy / f"crates/{crate}/src/lib.rs").open("a") as lib:
                lib.write(SWITCH)
        programs = built(copy, target, crates)
        of = lambda crate, number: outcome(programs[crate], copy / "crates" / crate, number)
        for crate in crates:
            if failed := of(crate, 0):
                sys.exit(f"palpate-{crate} fails without a mutant: {failed}")
        chosen = [(number, mutant) for number, mutant in mutants if not wanted or number in wanted]
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            results = list(pool.map(lambda one: of(crate_of(one[1]), one[0]), chosen))
        for (number, mutant), failed in zip(chosen, results):
            print(f"{number:2} {mutant['why']}: {'NOBODY NOTICES' if failed is None else failed[0]}")
        living = sum(failed is None for failed in results)
        if living:
            sys.exit(f"{living} of {len(chosen)} mutants live")
        print(f"{len(chosen)} mutants, each noticed")
    finally:
        shutil.rmtree(copy)


main()
