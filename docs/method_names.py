"""What the methods are called in the documents: by what they are, with the name of their config apart.

Runs are stored under the names of `experiments/neural_gash/variants.py`: the config (`gash train NAME`), the frame,
whether they are residual, and "-long" where they had more time. The frame of the tables goes without saying.
"""

from experiments.neural_gash.variants import LONG, RUNS, SHORT

_NAMES = {
    "closed form": "closed form, no shadows",
    "mlp": "MLP",
    "mlp-deep": "MLP, deeper",
    "gnn": "GATv2",
    "teacher": "GATv2, visibility given",
    "student-mlp": "MLP, distilled",
    "student-gnn": "GATv2, distilled",
    "two-stage": "TransformerConv + GATv2",
    "local": "surfel network (`local`)",
}
WHAT = {
    "mlp": "the motor of a vertex through an MLP, no neighbours (the first paper)",
    "mlp-deep": "the same, twice as deep and wide, trained on the whole corpus",
    "gnn": "one graph network from motors to coefficients",
    "teacher": "the same, told the traced visibility of 25 directions at every vertex: no prediction without rays",
    "student-mlp": "the MLP, trained on the predictions of the network above",
    "student-gnn": "a smaller GATv2, trained on the predictions of the same network",
    "two-stage": "TransformerConv predicts the visibility of 25 directions, GATv2 the coefficients from it",
    "local": "our own: shadow from a tree of surfels, in frames that turn with the mesh",
}


def reading_name(frame: str, residual: bool) -> str:
    """What a reading of the paper is called."""
    return f"frame {frame}{', residual' if residual else ''}"


def method_name(key: str) -> str:
    """What a method of the results is called; names that are words already stay as they are."""
    base = key.removesuffix(" + AO")
    name = _NAMES.get(base, base)
    if base in RUNS:
        run, name = RUNS[base], _NAMES[RUNS[base].variant]
        if run.long:
            name += f", {LONG[run.variant] / 60:.0f} min"
        if not run.shown:
            name += f", {reading_name(run.frame, run.residual)}"
    return f"{name}; with ambient occlusion" if base != key else name


def key_of_names() -> str:
    """A table with name, config and meaning of every network that is compared."""
    rows = [f"| {_NAMES[name]} | `{name}` | {WHAT[name]} |" for name in (*SHORT, "local")]
    return "\n".join(["| method | config (`gash train NAME`) | what it is |", "|---|---|---|", *rows])
