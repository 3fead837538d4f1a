"""Models: the same answers as `palpate solve`, to the last bit."""

import math
import threading

import numpy as np
import palpate
import pytest
from conftest import EXAMPLE, NUMBERS


@pytest.fixture(scope="module", params=["pearson", "surrogate"])
def model(request, table):
    return palpate.fit(table, request.param)


def same(ours, text):
    """Whether a number has the bits of a cell; an empty cell is NaN."""
    return math.isnan(ours) if text == "" else ours == float(text) and math.copysign(1, ours) == math.copysign(1, float(text))


def test_a_batch_has_the_bits_of_the_program(model, readings, solve_by_program, tmp_path):
    model.save(tmp_path / "a.palpate")
    expected = solve_by_program(tmp_path / "a.palpate", readings)
    for solved in [model.solve(readings), palpate.Model.load(tmp_path / "a.palpate").solve(readings), model.session().solve(readings)]:
        for name in NUMBERS:
            assert all(map(same, solved[name], expected[name])), name
        assert list(solved.verdict) == expected["verdict"]
        assert [str(unit or "") for unit in solved.unit] == expected["unit"]
        assert [error or "" for error in solved.error] == expected["error"]
    assert len(set(expected["verdict"])) >= 3, set(expected["verdict"])


def test_single_readings_have_the_bits_of_the_program(model, readings, solve_by_program, tmp_path):
    model.save(tmp_path / "a.palpate")
    expected, session = solve_by_program(tmp_path / "a.palpate", readings), model.session()
    for row, reading in enumerate(readings):
        contact = session.solve(reading)
        assert all(same(getattr(contact, name), expected[name][row]) for name in NUMBERS), row
        assert (contact.verdict, str(contact.unit or "")) == (expected["verdict"][row], expected["unit"][row])
        assert (contact.error or "") == expected["error"][row]


def test_without_forces_the_force_is_relative(readings, solve_by_program, tmp_path):
    rows = [row.split(",") for row in (EXAMPLE / "calibration.csv").read_text().splitlines()]
    kept = [column for column, name in enumerate(rows[0]) if name in ("x_mm", "y_mm") or name.startswith("out_")]
    (tmp_path / "grid.csv").write_text("".join(",".join(row[column] for column in kept) + "\n" for row in rows))
    with pytest.warns(UserWarning, match="no force_n in the calibration"):
        model = palpate.fit(tmp_path / "grid.csv", "surrogate")
    model.save(tmp_path / "a.palpate")
    solved, expected = model.solve(readings), solve_by_program(tmp_path / "a.palpate", readings)
    for name in NUMBERS:
        assert all(map(same, solved[name], expected[name])), name
    assert np.isnan(solved.force_n).all() and np.isfinite(solved.relative_force).any()


def test_each_call_of_a_model_is_a_session_of_its_own(model, readings):
    dead = readings[40:].copy()
    dead[:, 4] = 3.0
    before = model.solve(readings[40])
    model.solve(dead)
    again = model.solve(readings[40])
    assert [getattr(before, name) for name in NUMBERS[:3]] == [getattr(again, name) for name in NUMBERS[:3]]
    assert model.broken == []


def test_a_unit_that_breaks_in_a_session_is_excluded(table, readings):
    session = palpate.fit(table, "surrogate").session()
    dead = np.repeat(readings[40:], 5, axis=0) + np.random.default_rng(2).normal(0, 0.01, (1800, 9))
    dead[:, 4] = 0.0
    contacts = session.solve(dead)
    assert session.broken == [5]
    assert session.at_fault[5] >= 1e4
    again = palpate.fit(table, "surrogate").session().solve(dead)
    np.testing.assert_array_equal(contacts.x_mm, again.x_mm)  # a batch waits for its searches


def test_a_sensor_that_no_longer_fits_its_calibration_is_reported(table):
    session = palpate.fit(table, "surrogate").session()
    outputs = palpate.load(EXAMPLE / "test.csv").presses.outputs
    session.solve(outputs)
    assert not session.is_out_of_date
    session.solve(outputs + outputs[::-1])  # two contacts at once
    assert session.is_out_of_date


def test_readings_of_any_type_are_taken(model, readings):
    expected = model.solve(readings[50])
    given = [list(readings[50]), tuple(readings[50]), np.asfortranarray(readings)[50], readings[:, ::-1][50, ::-1]]
    for reading in given:
        assert model.solve(reading).x_mm == expected.x_mm
    batch = model.solve(np.asfortranarray(readings[50:60]))
    np.testing.assert_array_equal(batch.x_mm, model.solve(readings[50:60]).x_mm)
    assert len(model.solve(np.empty((0, 9)))) == 0
    integers = model.solve(np.arange(9))
    assert integers.verdict == model.solve(np.arange(9.0)).verdict


@pytest.mark.parametrize("wrong", [np.zeros(8), np.zeros((3, 10)), np.zeros((2, 2, 9)), 1.0])
def test_readings_of_another_shape_are_refused(model, wrong):
    with pytest.raises(ValueError, match="outputs|dimensions"):
        model.solve(wrong)


def test_other_threads_go_on_while_a_batch_is_solved(table, readings):
    model = palpate.fit(table, "surrogate")
    batch, done, counted = np.tile(readings[40:], (50, 1)), threading.Event(), 0
    solving = threading.Thread(target=lambda: (model.solve(batch), done.set()))
    solving.start()
    while not done.is_set():
        counted += 1
    solving.join()
    assert counted > 100


def test_threads_share_a_model(model, readings):
    expected, found = model.solve(readings), {}

    def solve(thread):
        found[thread] = [model.solve(readings).x_mm, [model.solve(reading).x_mm for reading in readings[:100]]]

    threads = [threading.Thread(target=solve, args=(thread,)) for thread in range(4)]
    [thread.start() for thread in threads]
    [thread.join() for thread in threads]
    for batch, single in found.values():
        np.testing.assert_array_equal(batch, expected.x_mm)
        np.testing.assert_array_equal(single, [model.solve(reading).x_mm for reading in readings[:100]])


def test_the_options_of_fit_are_those_of_the_command(table):
    chosen = palpate.fit(EXAMPLE / "calibration.csv", false_alarms=0.05, forces_n=(0.05, 2.0), common_offset=True)
    assert chosen.solver in repr(chosen) and chosen.x_mm == (-6.0, 6.0) and chosen.outputs == 9
    with pytest.raises(palpate.UsageError, match="invalid value 'none' for '--solver': expected one of best"):
        palpate.fit(table, "none")
    with pytest.raises(palpate.UsageError, match="the first force must be smaller"):
        palpate.fit(table, forces_n=(2.0, 1.0))
    with pytest.raises(palpate.UsageError, match="between 0 and 1"):
        palpate.fit(table, false_alarms=2)


def test_only_a_sensor_file_is_replaced(table, tmp_path):
    model = palpate.fit(table, "pearson")
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(palpate.UsageError, match="isn't a sensor file"):
        model.save(tmp_path / "notes.txt")
    model.save(tmp_path / "a.palpate")
    model.save(tmp_path / "a.palpate")
    with pytest.raises(palpate.UsageError, match="isn't a sensor file"):
        palpate.Model.load(tmp_path / "notes.txt")


def test_the_file_is_that_of_the_command(table, program, tmp_path):
    import subprocess

    palpate.fit(table, "pearson").save(tmp_path / "ours.palpate")
    command = [program, "fit", EXAMPLE / "calibration.csv", "--solver", "pearson", "--out", tmp_path / "its.palpate"]
    subprocess.run(command, check=True, capture_output=True)
    assert (tmp_path / "ours.palpate").read_bytes() == (tmp_path / "its.palpate").read_bytes()


def test_other_objects_are_refused_with_what_is_expected(model, table):
    presses = palpate.load(EXAMPLE / "test.csv").presses
    with pytest.raises(TypeError, match="use the `outputs` of the frame"):
        model.solve(presses)
    for given in [None, presses, 7]:
        with pytest.raises(TypeError, match="expected a Run, or the path of a run folder or of a table, not <class"):
            palpate.fit(given)
