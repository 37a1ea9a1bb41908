"""The table of textures in docs/light.md, from what experiments/textures wrote."""

from typing import Any

from docs.baking_tables import origin
from docs.local_tables import table


def texture_table(result: dict[str, Any]) -> str:
    """Bytes and errors of each representation of each mesh; of textures also as baked, with seams that show."""
    rows = []
    for row in result["rows"]:
        texture = row["way"] == "texture"
        what = f"texture, {row['detail']}²" if texture else "vertices" if not row["detail"] else "subdivided"
        cells = [row["mesh"], what, str(row["samples"]), f"{row['bytes'] / 1000:.0f}", f"{row['radiance']:.4f}"]
        if texture:
            cells += [f"{row['radiance_before']:.4f}", f"{row['seam_jump_before']:.4f}, {row['seam_jump']:.4f}"]
        rows.append(cells if texture else [*cells, "", ""])
    header = ["mesh", "transfer at", "vertices or texels baked", "kB", "radiance, relrmse", "before seams are equal"]
    arguments = result["arguments"]
    told = f"{arguments['rays']} rays, reference {arguments['points']} points of {arguments['reference_rays']} rays"
    return f"{table([*header, 'seam jump: before, after'], rows)}\n\n{told}; {origin(result)}, seed {result['seed']}."
