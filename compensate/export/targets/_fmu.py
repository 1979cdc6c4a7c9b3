"""A functional mock-up unit of FMI 2.0 or 3.0 for co-simulation: its sources, and a binary."""

import platform
import uuid
from pathlib import Path

from .._export import Exported, Program
from ._artefact import Artefact, name_in_c

BINARIES = {
    2: {"x86_64": "linux64"},
    3: {"x86_64": "x86_64-linux", "aarch64": "aarch64-linux"},
}
"""Folders of binaries, by version of FMI and machine."""


def fmu2(program: Program, out: Path, real: str) -> Exported:
    """Write an FMU of FMI 2.0."""
    return _fmu(program, out, real, 2)


def fmu3(program: Program, out: Path, real: str) -> Exported:
    """Write an FMU of FMI 3.0."""
    return _fmu(program, out, real, 3)


def _fmu(program: Program, out: Path, real: str, version: int) -> Exported:
    made = Artefact(program, name_in_c(out), real)
    token = str(
        uuid.uuid5(uuid.NAMESPACE_OID, f"{made.stem} {version} {made.document['checksum']}")
    )
    made.words |= {
        "token": f"{{{token}}}",
        "version": version,
        "step": made.usual_step / made.per_second,
    }
    made.add_template("fmu/modelDescription.xml", "modelDescription.xml")
    made.add_header(f"sources/{made.stem}.h")
    made.add_template("fmu/fmu.c", f"sources/{made.stem}_fmu.c")
    if version == 3:
        made.add_template("fmu/buildDescription.xml", "sources/buildDescription.xml")
    made.add_runtime("resources/hysid-export.json")
    made.add_template("fmu/index.html", "documentation/index.html")
    folder = BINARIES[version].get(platform.machine())
    binary = folder and made.compiled(
        {path: text for path, text in made.files.items() if path.startswith("sources/")},
        f"sources/{made.stem}_fmu.c",
    )
    if binary:
        made.files[f"binaries/{folder}/{made.stem}.so"] = binary
    return Exported(made.write_archive(out), (*program.notes, *made.notes))
