"""Evaluation, page and certificate are those of the command."""

import json
import subprocess

import palpate
import pytest
from conftest import EXAMPLE


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    out = tmp_path_factory.mktemp("runs") / "run"
    list(palpate.run(EXAMPLE / "short.toml", sensor="A-017", out=out))
    return palpate.load(out)


def printed(program, *words):
    done = subprocess.run([program, *words, "--json"], capture_output=True, text=True)
    assert done.returncode in (0, 1), done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


def test_the_evaluation_is_that_of_the_command(run, program):
    accept = EXAMPLE / "accept.toml"
    ours = palpate.evaluate(run, solver="pearson", accept=accept)
    errors, judgement = printed(program, "evaluate", run.path, "--solver", "pearson", "--accept", accept)
    mine = ours.methods["pearson"]
    timed = {"ns_per_solve"}
    assert {key: mine[key] for key in mine.keys() - timed} == {key: errors[key] for key in mine.keys() - timed}
    assert ours.judgement == judgement and ours.verdict == judgement["verdict"]
    assert ours.failures == {} and ours.cross_validated is None and "pearson: " in repr(ours)


def test_a_table_is_held_out_or_cross_validated(tmp_path):
    table = EXAMPLE / "calibration.csv"
    first = palpate.evaluate(table, solver="pearson", holdout=("places", 0.2), seed=3, save=tmp_path / "parts")
    again = palpate.evaluate(tmp_path / "parts" / "calibration.csv", tmp_path / "parts" / "test.csv", "pearson")
    assert first.methods["pearson"]["location_error_mm"] == again.methods["pearson"]["location_error_mm"]
    assert palpate.evaluate(table, solver="pearson").cross_validated[0]["solver"] == "pearson"
    with pytest.raises(palpate.UsageError, match="expected one of best, all, pearson"):
        palpate.evaluate(table, solver="none")
    with pytest.raises(palpate.UsageError, match="expected places, press or time"):
        palpate.evaluate(table, holdout=("place", 0.2))


def test_the_page_is_that_of_the_command(run, program, tmp_path):
    page = palpate.report(run, out=tmp_path / "ours.html", figures=tmp_path / "figures")
    its, = printed(program, "report", run.path, "--out", tmp_path / "its.html")
    assert page["result"] == its["result"] and page["page"] == tmp_path / "ours.html"
    assert (tmp_path / "ours.html").read_text() == (tmp_path / "its.html").read_text()
    assert list((tmp_path / "figures").glob("*.svg"))
    with pytest.raises(TypeError, match="one run or more"):
        palpate.report()


def test_the_certificate_is_that_of_the_command(run, program, tmp_path):
    given = EXAMPLE / "certificate.toml"
    ours = palpate.certificate(run, given=given, out=tmp_path / "ours")
    its, = printed(program, "certificate", run.path, "--with", given, "--out", tmp_path / "its")
    assert ours["result"] == its["result"] and ours["verdict"] == its["verdict"]
    assert [file.name for file in ours["files"]] == ["ours.html", "ours.xml"]
    with pytest.raises(palpate.UsageError, match="already exists"):
        palpate.certificate(run, given=given, out=tmp_path / "ours")
