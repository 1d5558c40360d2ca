"""Do other programs find our meshes closed, oriented and of positive volume? Usage: check-meshes.py FILE..."""
import re
import subprocess
import sys

import trimesh

failed = 0
for path in sys.argv[1:]:
    # As an importer reads them: vertices at one place become one. Several organs are joined, and stay closed.
    mesh = trimesh.load(path, force="mesh", process=True)
    mesh.merge_vertices(merge_norm=True, merge_tex=True)
    facts = {
        "closed": mesh.is_watertight,
        "oriented": mesh.is_winding_consistent,
        "volume > 0": mesh.volume > 0,
    }
    if path.endswith(".stl"):
        report = subprocess.run(["admesh", path], capture_output=True, text=True, check=True).stdout
        for name in ["Total disconnected facets", "Degenerate facets", "Edges fixed", "Facets reversed", "Backwards edges"]:
            first = re.search(re.escape(name) + r"\s*:\s*(\d+)", report)
            facts[f"admesh: {name} = 0"] = first is not None and int(first.group(1)) == 0
    wrong = [name for name, holds in facts.items() if not holds]
    print(f"{path}: {len(mesh.faces)} triangles, volume {mesh.volume:.6g} in its own unit: {'FAILED ' + ', '.join(wrong) if wrong else 'ok'}")
    failed += bool(wrong)
print(f"{len(sys.argv) - 1 - failed} passed, {failed} failed")
sys.exit(failed > 0)
