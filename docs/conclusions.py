"""The conclusions that the results page begins with: the words are here, every number is computed from the results.

A test holds the words to the committed results.
"""

import textwrap
from typing import Any

import numpy as np

from docs.cga_table import mean_skill, seed_differences
from docs.local_tables import faster, share
from docs.method_names import method_name
from experiments.neural_gash.variants import LONG, READING, SHIPPED, Run

Results = dict[str, dict[str, Any]]
TARGET = 0.02
YARDSTICK_RAYS = (4, 8, 16)
WIDTH = 125  # of a line of the documents


def numbers(result: dict[str, Any], method: str, key: str) -> np.ndarray:
    """What is known of a method over the meshes."""
    values = [row["methods"][method].get(key) for row in result["rows"]]
    return np.array([value for value in values if isinstance(value, float)])


def median_rays(values: list[Any]) -> str:
    """Median of equivalent rays, of which some are only bounds."""

    def rank(value: Any) -> float:
        return value if isinstance(value, float) else 0.0 if value.startswith("<") else float("inf")

    known = sorted((value for value in values if value != "no transfer"), key=rank)
    middle = known[len(known) // 2]
    return f"{middle:.1f}" if isinstance(middle, float) else middle


def _skill(result: dict[str, Any], method: str) -> str:
    skills = numbers(result, method, "skill")
    return f"{np.median(skills):.2f} (worst {skills.min():.2f})"


def _time(result: dict[str, Any], method: str) -> float:
    """Median microseconds a vertex, graph and network together."""
    return float(np.median(numbers(result, method, "graph_us") + numbers(result, method, "network_us")))


def beaten(result: dict[str, Any], method: str) -> str:
    """On how many meshes some plain bake has a smaller error in less time than graph and network together."""
    if "graph_us" not in result["rows"][0]["methods"][method]:
        return "-"
    wins = 0
    for row in result["rows"]:
        mine = row["methods"][method]
        bakes = (row["methods"][f"plain bake, {rays} rays"] for rays in YARDSTICK_RAYS)
        time = mine["graph_us"] + mine["network_us"]
        wins += any(bake["mse"] <= mine["mse"] and bake["network_us"] <= time for bake in bakes)
    return f"{wins} of {len(result['rows'])}"


def baking(results: Results) -> str:
    """Rays: error bars and error targets."""
    coverage = np.array([row["256 rays"][1] for row in results["calibration"]["rows"]])
    aimed = [row for row in results["error_target"]["rows"] if row["error"] == TARGET]
    missed = max(row["true"] / row["error"] for row in aimed)
    rays = np.median([row["ratio"] for row in aimed])
    return (
        f"**A bake knows its error.** In {len(coverage)} scenes whose transfer is a formula, the 95 % intervals of 256 "
        f"rays hold {coverage.min():.0%} to {coverage.max():.0%} of the errors. Told to reach {TARGET:.0%}, bakes of "
        f"{len(aimed)} real meshes came out at {missed:.2f} times that or less, with {rays:.2f} times the rays of the "
        "plain bake at the median ([baking](baking.md))."
    )


def ours(results: Results) -> str:
    """`local` beside rays."""
    result = results["neural_gash"]
    rays = median_rays([row["methods"]["local"]["equivalent_rays"] for row in result["rows"]])
    return (
        f"**Without rays, `local` has the error of a plain bake of {rays} rays a vertex** at the median: skill "
        f"{_skill(result, 'local')} on {len(result['rows'])} meshes that no network has seen, "
        f"{_time(result, 'local'):.0f} us a vertex. On a CPU that traces rays well this is no clear win: timed side by "
        f"side it takes less time than the plain bake of the same error on {faster(results['local_speed'])} meshes."
    )


def published(results: Results) -> str:
    """The papers' networks on unseen meshes."""
    result = results["neural_gash"]
    named = [Run(variant, *READING, long=long).name for variant in LONG for long in (False, True)]
    known = [name for name in named if name in result["rows"][0]["methods"]]
    skills = ", ".join(f"{method_name(name)} {_skill(result, name)}" for name in known)
    teacher, best = Run("teacher", *READING).name, numbers(result, known[-1], "skill")
    told = ""
    if teacher in result["rows"][0]["methods"]:
        told = (
            f"Told the traced visibility of 25 directions, its second stage reaches {_skill(result, teacher)}: what is "
            "missing is lost where 16 neighbours have to say what is far away. "
        )
    return (
        "**Given time and one frame, the published two-stage network beats a formula without shadows on most meshes, "
        "and plain bakes beat it.** Skill 0 is the closed form; median skills: "
        f"{skills}. With {LONG['two-stage'] // 60} minutes it is above 0 on {np.count_nonzero(best > 0)} of "
        f"{len(best)} meshes that have shadows, {best.min():.2f} at worst. {told}"
        "In the world's axes all but the MLP are [worse](#how-the-paper-is-read). The MLP is the fastest of all, "
        f"{_time(result, known[0]):.1f} us a vertex, and the graph networks lose to plain bakes in error and in time."
    )


def encodings(results: Results) -> str:
    """Motors as input, and layers that are products in their algebra."""
    result = results["cga"]
    shown, elsewhere = (seed_differences(result, "gnn", "motor", unseen) for unseen in (False, True))
    return (
        "**A motor says no more to a network than position and normal.** In the published form it changes the skill by "
        f"{shown} on generated shapes and by {elsewhere} on meshes from elsewhere; relative motors in frames that turn "
        f"with the mesh change it by {seed_differences(result, 'rings', 'relative-motor')}. Told these, layers that "
        f"are products in R(4,1) reach {mean_skill(result, 'versor', 'relative-motor')} and attention reaches "
        f"{mean_skill(result, 'rings', 'relative-motor')}; told plain features of edges, attention reaches "
        f"{mean_skill(result, 'rings', 'relative')}. Frame and features count for more than the algebra "
        "([below](#what-should-a-vertex-be-told-as))."
    )


def speed(results: Results) -> str:
    """The same networks in PyTorch Geometric; deforming meshes."""
    ratios = [row["pyg"] / (row["stage1"] + row["stage2"]) for row in results["latency"]["rows"] if row["pyg"]]
    compared = f"{min(ratios):.0f} to {max(ratios):.0f} times as fast as" if ratios else "not timed beside"
    motions = results["local_speed"]["motions"].values()
    times, skills = [row["frame_ms"] for row in motions], [row["plan kept"]["skill"] for row in motions]
    return (
        f"**The code is fast where the networks are not.** The papers' two stages run {compared} the same weights in "
        f"PyTorch Geometric on the same two cores. On meshes that deform, `local` takes {min(times):.0f} to "
        f"{max(times):.0f} ms a frame with a skill of {min(skills):.2f} to {max(skills):.2f}."
    )


def trust(results: Results) -> str:
    """`predicted_error` beside the true error."""
    found = results["local_trust"]["calibration"]
    ranks = [row["rank_correlation"] for row in found["meshes"] if row["rank_correlation"] is not None]
    shares = [row["inside"] for row in found["meshes"] if row["inside"] is not None]
    by_mesh = f", by mesh {share(min(shares))} to {share(max(shares))}" if shares else ""
    return (
        "**`predicted_error` shows where to look, and a factor in the model file makes it a bound.** Meant to hold "
        f"90 % of the vertices that are partly hidden, the bound holds {share(found['inside'])} of them on "
        f"{len(found['meshes'])} meshes that no network has seen{by_mesh}. Of a mesh, it ranks them with a "
        f"correlation of {np.median(ranks):.2f} at the median."
    )


def reach(results: Results) -> str:
    """What the surfel network says besides three bands of direct light, and in what is nearly dark."""
    found = results["local_reach"]
    relative = [row["relative"] for row in found["rows"] if row["relative"] is not None]
    shapes = [row["relative"] for row in found["shapes"] if row["relative"] is not None]
    text = (
        f"**Relative to the light that arrives, `local` errs by {np.median(relative):.3f}** at the median over the "
        f"meshes, dark places counting like lit ones, and by {np.median(shapes):.3f} on generated shapes of all kinds. "
    )
    *_, most = found["rows"][0]["bands"]
    alone = [row["bands"][-1]["skill_of_last"] for row in found["rows"]]
    known = [value for value in alone if value is not None]
    if known:
        text += f"Of {most['bands']} bands the last alone has a skill of {np.median(known):.2f}"
    if found["rows"][0]["bounces"]:
        last = [[row["bounces"][-1][key] for row in found["rows"]] for key in ("relrmse", "left_out")]
        with_them, without = (np.median([value for value in values if value is not None]) for values in last)
        count = found["rows"][0]["bounces"][-1]["bounces"]
        text += f"; with {count} bounces off an albedo of {found['arguments']['albedo']:g} its relrmse is "
        text += f"{with_them:.3f}, and {without:.3f} with the bounces left out"
    return text.rstrip() + "."


def verdict(results: Results) -> str:
    """What the README says below the table of one mesh, from the tables of many."""
    result = results["neural_gash"]
    mlp, two_stage = SHIPPED["mlp"], SHIPPED["two-stage"]
    rays = median_rays([row["methods"][mlp]["equivalent_rays"] for row in result["rows"]])
    return textwrap.fill(
        "Over many meshes that no network has seen ([results](docs/results.md)): timed side by side, "
        f"`local` takes less time than the plain bake of the same error on {faster(results['local_speed'])}. A plain "
        f"bake of {YARDSTICK_RAYS[-1]} rays or fewer has less error in less time than `two-stage`, the published graph "
        f"network, on {beaten(result, two_stage)}, and than `mlp` on {beaten(result, mlp)}; the error of `mlp` is that "
        f"of {rays} rays at the median. What networks offer is a prediction without rays, and the tables are there to "
        "say what that costs.",
        WIDTH,
        break_on_hyphens=False,
    )


CONCLUSIONS = (baking, ours, reach, published, encodings, speed, trust)


def conclusions(results: Results) -> str:
    """All of them, as a list."""
    return "\n".join(f"- {write(results)}" for write in CONCLUSIONS)
