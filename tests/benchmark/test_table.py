"""The table of results as Markdown: means over seeds, differences, missing figures, and the source's figures."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import replace

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pocketgs.benchmark.aggregate import PSNR, SSIM, difference, ratio, rows_of, stage_seconds, stages_of
from pocketgs.benchmark.methods import METHODS
from pocketgs.benchmark.published import ABLATIONS, COMPARISON
from pocketgs.benchmark.results import CellResult
from pocketgs.benchmark.sections import (
    Table,
    differences_table,
    failures_table,
    figures_table,
    machines_table,
    summary_table,
)
from pocketgs.benchmark.table import markdown_table

MakeResult = Callable[..., CellResult]


def column(table: Table, name: str) -> dict[str, str]:
    """A column's cells by the first column."""
    place = table.head.index(name)
    return {row[0]: row[place] for row in table.rows}


def parsed(markdown: str) -> list[list[list[str]]]:
    """The tables of a Markdown document: rows of cells, the head first, split as Markdown splits them."""
    tables: list[list[list[str]]] = [[]]
    for line in markdown.splitlines():
        if line.startswith("| "):
            tables[-1].append([cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]])
        elif tables[-1]:
            tables.append([])
    return [table for table in tables if table]


def test_a_mean_over_seeds_has_half_the_range_for_its_spread(made_result: MakeResult) -> None:
    results = [made_result(seed=seed, psnr=psnr) for seed, psnr in enumerate((28.0, 28.5, 28.2))]
    table = figures_table(results, "fern")
    assert column(table, "PSNR (dB)")["pocketgs"] == "28.23 ± 0.25"
    assert column(table, "runs")["pocketgs"] == "3 of 3"
    assert column(table, "Gaussians")["pocketgs"] == "50,000"


def test_one_seed_has_no_spread(made_result: MakeResult) -> None:
    table = figures_table([made_result(psnr=28.2)], "fern")
    assert column(table, "PSNR (dB)")["pocketgs"] == "28.20"
    assert not any("Means over seeds" in note for note in table.notes)


def test_a_failed_run_is_left_out_of_the_mean_and_named(made_result: MakeResult, failed_result: MakeResult) -> None:
    results = [made_result(seed=0, psnr=28.0), failed_result("fern", "pocketgs", 1, "out\nof paper")]
    table = figures_table(results, "fern")
    assert column(table, "PSNR (dB)")["pocketgs"] == "28.00"
    assert column(table, "runs")["pocketgs"] == "1 of 2"
    failures = failures_table(results)
    assert failures is not None
    assert failures.rows == (("fern.pocketgs.1", "out of paper"),)


def test_a_method_of_which_all_runs_failed_still_has_its_row(failed_result: MakeResult) -> None:
    table = figures_table([failed_result("fern", "pocketgs", 0, "no")], "fern")
    assert column(table, "LPIPS")["pocketgs"] == "n/a"
    assert column(table, "runs")["pocketgs"] == "0 of 1"


def test_a_seed_that_only_other_methods_have_is_missed(many_results: list[CellResult]) -> None:
    assert column(figures_table(many_results, "fern"), "runs")["3dgs-sfm"] == "1 of 2"
    assert "(1 of 2)" in column(summary_table(many_results), "3dgs-sfm")["fern"]
    failures = failures_table(many_results)
    assert failures is not None
    assert failures.rows == (("fox.no-seeding.1", "it ran out of paper"),)
    assert failures_table([it for it in many_results if it.cell.method == "pocketgs"]) is None


@pytest.mark.parametrize("missing", [None, math.nan, math.inf, "text", True])
def test_what_is_no_number_is_not_averaged(made_result: MakeResult, missing: object) -> None:
    results = [made_result(seed=0, lpips=0.125, ssim=missing), made_result(seed=1, lpips=missing, ssim=missing)]
    table = figures_table(results, "fern")
    assert column(table, "LPIPS")["pocketgs"] == "0.125 (1 of 2)"
    assert "SSIM" not in table.head
    assert "no LPIPS here" in table.notes


def test_short_stages_are_put_together_and_unknown_ones_kept(made_result: MakeResult) -> None:
    assert stage_seconds(made_result()) == {"start": 1.5, "depth": 4.0, "training": 15.0, "evaluation": 2.0}
    assert stage_seconds(made_result(seconds={"poses": 1.0, "keyframes": 0.5, "colmap": 2.0})) == {
        "poses": 1.5,
        "colmap": 2.0,
    }


def test_points_to_start_from_are_a_stage_of_their_own(made_result: MakeResult) -> None:
    seconds = {"planning": 0.5, "capture": 1.0, "training": 9.0, "seeding": 0.25, "points": 7.0}
    result = made_result(seconds=seconds)
    assert stage_seconds(result) == {"start": 1.5, "training": 9.0, "fusion, seeds": 0.25, "points": 7.0}
    assert stages_of([result]) == ["start", "fusion, seeds", "points", "training"]


def test_warnings_of_runs_are_notes_with_their_methods(made_result: MakeResult) -> None:
    few, odd = {"warnings": ["too few points"]}, {"warnings": ["poses stay as given", "too few points"]}
    results = [made_result(prior=few), made_result(seed=1, prior=few), made_result(method="no-dense", prior=odd)]
    results += [made_result(method="no-bundle", prior=None), made_result(method="no-seeding", prior={"warnings": []})]
    notes = figures_table(results, "fern").notes
    assert notes[:2] == ("pocketgs, no-dense: too few points.", "no-dense: poses stay as given.")
    assert "too few points" in markdown_table(results)
    assert not any("no-bundle" in note or "no-seeding" in note for note in notes)


def test_memory_that_leaves_colmap_out_is_said_to(made_result: MakeResult) -> None:
    def said(*methods: str) -> list[str]:
        notes = figures_table([made_result(method=method) for method in methods], "fern").notes
        return [note for note in notes if "COLMAP" in note]

    assert said("pocketgs", "3dgs-mvs") == []
    (note,) = said("pocketgs", "3dgs-sfm")
    assert "3dgs-sfm" in note
    assert "not included" in note


def test_gpu_memory_is_that_of_the_gpu_engine_only(made_result: MakeResult) -> None:
    assert "GPU memory (MB)" not in figures_table([made_result()], "fern").head
    results = [made_result(), made_result(method="no-dense", engine="webgpu")]
    assert column(figures_table(results, "fern"), "GPU memory (MB)") == {
        "pocketgs": "n/a",
        "no-dense": "12",
        **{f"source: {name}": "–" for name in ("3DGS-SFM-WK", "3DGS-MVS-WK", "PocketGS")},
    }


def test_differences_are_taken_seed_by_seed(made_result: MakeResult) -> None:
    results = [made_result(seed=0, psnr=20.0), made_result(seed=1, psnr=28.0)]
    results.append(made_result(method="no-dense", seed=1, psnr=25.0))
    rows = {row.method: row for row in rows_of(results, "fern")}
    change = difference(rows["no-dense"], rows["pocketgs"], PSNR)
    assert change is not None
    assert (change.value, change.count) == (-3.0, 1)
    assert column(figures_table(results, "fern"), "Δ pocketgs")["no-dense"] == "−3.00"
    assert column(figures_table(results, "fern"), "Δ pocketgs")["pocketgs"] == "–"
    factor = ratio(rows["no-dense"], rows["pocketgs"], SSIM)
    assert factor is not None
    assert factor.value == 1.0


def test_the_source_reports_what_it_is_said_to() -> None:
    assert {name: [row.psnr for row in rows] for name, rows in COMPARISON.items()} == {
        "LLFF": [21.01, 19.53, 23.54],
        "NeRF-Synthetic": [21.75, 24.47, 24.32],
        "MobileScan": [21.16, 20.85, 23.67],
    }
    named = {row.method for rows in (*COMPARISON.values(), ABLATIONS) for row in rows}
    assert named == {method.stands_for for method in METHODS.values()} - {None}


def test_the_sources_differences_stand_beside_ours(made_result: MakeResult) -> None:
    results = [
        made_result(psnr=28.9),
        made_result(method="3dgs-sfm", psnr=24.0),
        made_result(method="no-dense", psnr=23),
    ]
    results[1] = replace(results[1], wall_seconds=15.0)
    table = differences_table(results, "fern")
    assert table is not None
    rows = {row[0]: row[1:] for row in table.rows}
    assert rows == {
        "PocketGS − 3DGS-SFM-WK": (
            "1", "LLFF", "+2.53", "+4.90", "+0.150", "+0.000", "−0.183", "n/a", "0.98×", "2.00×",
        ),
        "w/o MVS − PocketGS": (
            "1", "MobileScan", "−2.60", "−5.90", "−0.145", "+0.000", "+0.189", "n/a", "0.49×", "1.00×",
        ),
    }  # fmt: skip
    assert differences_table([made_result("garden"), made_result("garden", "3dgs-sfm")], "garden") is None
    assert differences_table(results[1:], "fern") is None


def test_captures_are_held_against_the_dataset_of_their_kind(made_result: MakeResult) -> None:
    tables = {name: figures_table([made_result(name)], name) for name in ("lego", "fox", "garden")}
    assert {name: table.quoted for name, table in tables.items()} == {"lego": 3, "fox": 3, "garden": 0}
    assert column(tables["lego"], "PSNR (dB)")["source: 3DGS-MVS-WK"] == "24.47"
    assert column(tables["fox"], "Gaussians")["source: PocketGS"] == "168,000"
    assert "in kind, not in value" in tables["fox"].notes[-1]
    assert "one of its scenes" in tables["lego"].notes[-1]


def test_runs_under_other_conditions_are_told_apart(made_result: MakeResult) -> None:
    results = [made_result(), made_result(seed=1, iterations=200, versions={"python": "3.12"})]
    text = markdown_table(results)
    assert "fern.pocketgs.0: 498x372, every 8th held out; 17 training and 3 held-out views; 500 iterations" in text
    assert "fern.pocketgs.1: 498x372, every 8th held out; 17 training and 3 held-out views; 200 iterations" in text
    assert machines_table(results).head == ("", "fern.pocketgs.0", "fern.pocketgs.1")
    assert ("python", "3.11", "3.12") in machines_table(results).rows


def test_markdown_holds_the_figures_and_the_commands(many_results: list[CellResult]) -> None:
    text = markdown_table(many_results)
    tables = parsed(text)
    assert all(len({len(row) for row in table}) == 1 for table in tables)
    figures = next(table for table in tables if table[0][0] == "method" and "PSNR (dB)" in table[0])
    assert figures[2][:4] == ["pocketgs", "2 of 2", "28.25 ± 0.25", "–"]
    assert figures[-1][0] == "*source: PocketGS*"
    assert "\n    pocketgs train fern --method pocketgs --seed 0\n" in text
    assert "fern.pocketgs.0; likewise with seed 1:" in text


def test_nothing_in_a_name_means_anything_to_markdown(made_result: MakeResult) -> None:
    hostile = "a|b<script>alert(1)</script>\n\n# big *bold* [link](x) `code`"
    results = [made_result(hostile, hostile, protocol=hostile), made_result("fern", hostile)]
    text = markdown_table(results)
    assert all(len({len(row) for row in table}) == 1 for table in parsed(text))
    outside_code = "\n".join(line for line in text.splitlines() if not line.startswith("    "))
    assert not re.search(r"<script|(?<!\\)\[link|^# big|(?<!\\)`code", outside_code, re.MULTILINE)


@pytest.mark.parametrize("start", ["# a", "- a", "+ a", "> a", "---", "1. a", "12) a", "~~~", "===", "* a", "`a`"])
def test_how_a_line_begins_means_nothing_to_markdown(made_result: MakeResult, start: str) -> None:
    text = markdown_table([made_result(lpips_note=start)])
    (line,) = [line for line in text.splitlines() if line.replace("\\", "") == start]
    assert re.match(r"\d*\\", line)


def test_no_results_give_a_document() -> None:
    assert markdown_table([]).startswith("# Results\n")


@settings(max_examples=10, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_the_order_of_results_changes_nothing(many_results: list[CellResult], data: st.DataObject) -> None:
    assert markdown_table(data.draw(st.permutations(many_results))) == markdown_table(many_results)
