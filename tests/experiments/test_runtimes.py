"""The benchmark of runtimes, small, and its table."""

from pathlib import Path

import pytest

from docs.runtime_tables import runtime_table

pytest.importorskip("onnx", reason="needs the extra onnx: pip install onnx")
pytest.importorskip("onnxruntime", reason="needs onnxruntime to run what was exported")


@pytest.mark.slow
def test_all_runtimes_say_the_same_and_are_measured(tmp_path: Path) -> None:
    from benchmarks import runtimes

    result = runtimes.main(tmp_path / "runtimes.json", quick=True, repeats=1)
    assert [row["runtime"] for row in result["rows"]] == 2 * ["jax", "onnx", "numpy"]
    for row in result["rows"]:
        assert row["difference"] < 1e-5 and row["vertices"] == 162 and row["file_bytes"] > 10_000
        assert row["total_ms"] > row["graph_ms"] >= 0 and row["cpu_ms"] > 0 and row["peak_mib"] > 10
        assert (row["graph_ms"] > 0) == (row["runtime"] == "jax")
    mlp = {row["runtime"]: row["peak_mib"] for row in result["rows"][:3]}
    assert mlp["onnx"] < mlp["jax"] and mlp["numpy"] < mlp["jax"], "memory must be that of the runtime alone"
    assert (tmp_path / "runtimes.json").is_file()


def test_the_table_by_hand() -> None:
    row = {"network": "mlp", "vertices": 7, "file_bytes": 2048, "cpu_ms": 9.0, "peak_mib": 100.4, "difference": 2e-7}
    rows = [
        {**row, "runtime": "jax", "graph_ms": 3.0, "total_ms": 5.5},
        {**row, "runtime": "onnx", "graph_ms": 0.0, "total_ms": 2.0},
        {**row, "runtime": "numpy", "graph_ms": 0.0, "total_ms": 8.0},
    ]
    made = {"machine": {"processor": "P", "cores": 1}, "commit": "c", "arguments": {"repeats": 3}}
    lines = runtime_table({**made, "rows": rows}).split("\n")
    assert lines[2] == "| `mlp` | 7 | JAX | 2 | 3.0 | 2.5 | 5.5 | 9.0 | 100 |  |"
    assert lines[3] == "| `mlp` | 7 | ONNX Runtime | 2 |  | 2.0 |  | 9.0 | 100 | 2e-07 |"
    assert lines[4] == "| `mlp` | 7 | NumPy | 2 |  |  | 8.0 | 9.0 | 100 | 2e-07 |"
    assert lines[-1] == "Milliseconds, medians of 3; P, 1 cores, commit c."
