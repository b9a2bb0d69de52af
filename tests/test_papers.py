# SPDX-License-Identifier: Apache-2.0
"""The papers' tables, computed again: they agree where they must, and the page prints each of them."""

import re
import shutil

import instruction_count
import numpy as np
import papers
import pytest

PAGE = papers.PAGE.read_text(encoding="utf-8")
TABLES = {"S0": ("Table 1",), "S1": ("Table 1", "Table 2"), "S3": ("Table 1", "Table 2", "Table 3")}
FIGURES = (7, 8, 9, 10)


def test_s0_table_1_agrees_to_the_last_printed_digit():
    for printed, got in zip(papers.S0_TABLE_1, papers.s0_rows(), strict=True):
        np.testing.assert_allclose(got, printed, atol=5.001e-3)
        np.testing.assert_allclose(got[:3], printed[:3], atol=5.001e-5)


def test_the_fuzzy_rules_are_those_of_s3():
    assert papers.s3_rules() == [list(row) for row in papers.S3_TABLE_1]


@pytest.mark.slow(3)
def test_the_rotation_of_s3_stays_within_the_printed_error_and_does_not_lag():
    one = papers.experiment("s3_rotation")
    turning = papers.rotating(one)
    raw, extracted = (one.inclination_error(name)[turning] for name in ("raw", "s3"))
    assert np.abs(extracted).max() <= papers.S3_ROTATION_DEG
    assert papers.rms(raw) >= papers.S3_ROTATION_RAW_DEG
    # Less than one sample, which nobody sees in a plot.
    assert abs(papers.toolface_lag(one, "s3")) < 1.0


@pytest.mark.slow(6)
def test_the_deviations_of_s3_table_2_are_not_above_the_printed_ones_and_have_their_order():
    one = papers.experiment("s3_vibration", papers.AS_MEASURED)
    found = {name: papers.deviation(one, name)[1] for name in papers.S3_TABLE_2}
    assert found["s3"] < found["kalman"] < found["raw"]
    for name in ("s3", "kalman"):
        assert found[name] <= papers.S3_TABLE_2[name][1]
    # The vibration that the sensor is assumed to measure is the one that gives the printed deviation of the raw angle.
    assert found["raw"] == pytest.approx(papers.S3_TABLE_2["raw"][1], rel=0.05)
    at = papers.second_of_figures(one)
    spans = {name: np.ptp(one.inclination_error(name)[at]) for name in found}
    assert max(spans["s3"], spans["kalman"]) < 0.05 < spans["raw"]


def test_the_page_has_every_table_and_figure_and_its_pictures():
    for paper, names in TABLES.items():
        part = "".join(text for title, text in papers.sections_of(PAGE).items() if title.startswith(paper))
        for name in names:
            assert re.search(rf"^### {name}\b", part, re.MULTILINE), f"{paper}, {name}: run `make papers`"
    for number in FIGURES:
        assert f"![Figure {number}](images/paper_s3_figure{number}.png)" in PAGE
        assert (papers.IMAGES / f"paper_s3_figure{number}.png").stat().st_size > 10_000


def test_the_page_prints_every_value_of_the_papers():
    cells = set(re.findall(r"[^|\s][^|]*(?=\s\|)", PAGE))
    numbers = {word for cell in cells for word in cell.split()}
    for row in papers.S0_TABLE_1:
        assert {f"{v:.4f}" for v in row[:3]} | {f"{row.uncorrected:.2f}", f"{row.corrected:.1f}"} <= numbers
    for row in (*papers.S1_TABLE_1, *papers.S1_TABLE_2):
        assert {f"{value:.2f}" for value in row[1:]} <= numbers
    for values in papers.S3_TABLE_2.values():
        assert {f"{value:.4f}" for value in values} <= numbers
    for values in (papers.S3_PC_MS, papers.S3_CONTROLLER_MS):
        assert {f"{value:.4f}" for value in values.values()} <= numbers


def test_a_filter_with_matrices_costs_a_multiple_of_the_fuzzy_filter_without_a_floating_point_unit():
    counts = papers.counted()
    printed = papers.S3_CONTROLLER_MS["kalman"] / papers.S3_CONTROLLER_MS["s3"]
    for run in instruction_count.EXPERIMENTS:
        assert printed <= counts[run, "kalman_full"] / counts[run, "fuzzy"] < 2.0 * printed
        assert counts[run, "kalman_reduced"] < counts[run, "fuzzy"]


@pytest.mark.slow(6)
@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
@pytest.mark.parametrize(("options", "limit"), [(("-DDOUBLE",), 1e-12), ((), 1e-5)])
@pytest.mark.parametrize("experiment", list(instruction_count.EXPERIMENTS))
def test_the_filters_in_c_give_the_directions_of_the_python_kernels(tmp_path, experiment, options, limit):
    rates, forces = instruction_count.samples(experiment)
    instruction_count.write_samples(tmp_path, rates, forces)
    found = instruction_count.output([str(instruction_count.compiled(tmp_path, "cc", *options))])
    assert set(found) == set(instruction_count.FILTERS)
    for name, (_, directions) in found.items():
        expected = instruction_count.expected(name, rates, forces)
        assert instruction_count.furthest(directions, expected) < limit, name
