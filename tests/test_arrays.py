"""Public functions limit BLAS to one thread, and restore the others afterwards."""

import ast
import importlib
import inspect
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from hopdata.arrays import one_blas_thread
from hopdata.errors import AnalysisError
from hopdata.maps.verdict import judge
from hopdata.products import installed

SCRIPTS = sorted((Path(__file__).parents[1] / "workflow" / "scripts").glob("*.py"))
for product in installed():
    SCRIPTS += sorted(product.rules.with_name("scripts").glob("*.py"))
ROOMS = ("landings", "maps", "recordings", "steering", "synthesis")
# Files, tables, and options need no linear algebra worth a thread.
TABLES = {
    "join_feet",
    *("read_recording", "write_recording", "read_truth", "read_pairs", "write_pairs"),
    *("read_bases", "write_subspaces", "save_process", "load_process", "load_geometry"),
    *(
        "from_table",
        "learned_and_rest",
        "to_table",
        "true_map_of",
        "true_map_table",
        "training_table",
        "filled_table",
    ),
    *(
        "robot_and_camera",
        "common_scene",
        "require_distinct",
        "notes",
        "blurred",
        "taking_part",
    ),
    *(
        "check_plausible",
        "check_study",
        "contact_instants",
        "example_touchdown",
        "error_ratios",
    ),
    *(
        "exclude_stateless",
        "left_out",
        "mark_filled",
        "outcome_table",
        "section_frames",
    ),
    *("judged", "overlay_external_truth", "true_rows", "verdict_errors", "exact_table"),
    "study_landings",  # integrates landings one by one on demand
    *("save_film", "build_steering_report"),  # draw and write a page
    "shown_run",
    *("touchdown_tables", "horizons_of"),  # calls functions that each use one thread
}


def called_by_stages():
    for script in SCRIPTS:
        for node in ast.walk(ast.parse(script.read_text())):
            if (
                isinstance(node, ast.ImportFrom)
                and "." in node.module
                and node.module.split(".")[1] in ROOMS
            ):
                yield from ((node.module, alias.name) for alias in node.names)


def blas_threads():
    return {
        one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"
    }


@pytest.mark.parametrize(("module", "name"), sorted(set(called_by_stages())))
def test_what_a_stage_calls_works_with_one_thread(module, name):
    function = getattr(importlib.import_module(module), name)
    if inspect.isclass(function) or not callable(function):
        return
    assert not (
        hasattr(function, "__wrapped__") and inspect.isgeneratorfunction(function)
    )
    assert hasattr(function, "__wrapped__") != (name in TABLES)


def test_judge_works_with_one_thread_and_gives_the_others_back(monkeypatch):
    seen = []

    def look(*_, **__):
        seen.append(blas_threads())
        raise AnalysisError("seen enough")

    monkeypatch.setattr(
        sys.modules["hopdata.maps.verdict.inputs"], "section_landings", look
    )
    with threadpool_limits(2, user_api="blas"):
        judge([[0.0] * 6], [[0.0] * 6], [[0.0, 0.0]], seed=1)
        assert blas_threads() == {2}
    assert seen == [{1}]


def test_the_last_of_several_threads_gives_the_others_back():
    inside, leave = threading.Event(), threading.Event()

    def work():
        with one_blas_thread():
            inside.set()
            leave.wait(10)

    with threadpool_limits(2, user_api="blas"):
        other = threading.Thread(target=work)
        with one_blas_thread():
            other.start()
            inside.wait(10)
        assert blas_threads() == {1}
        leave.set()
        other.join()
        assert blas_threads() == {2}


def test_a_library_that_is_loaded_inside_is_limited_at_the_next_entry():
    program = (
        "import numpy\n"
        "from hopdata.arrays import one_blas_thread\n"
        "from threadpoolctl import threadpool_info\n"
        "threads = lambda: [one['num_threads'] for one in threadpool_info()]\n"
        "before = threads()\n"
        "with one_blas_thread():\n"
        "    import scipy.linalg\n"
        "    with one_blas_thread():\n"
        "        assert set(threads()) == {1}, threads()\n"
        "assert set(threads()) == set(before), threads()\n"
    )
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "2", "MKL_NUM_THREADS": "2"}
    subprocess.run(
        [sys.executable, "-c", program], env=environment, check=True, timeout=120
    )
