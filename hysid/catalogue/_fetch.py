"""A data set of the catalogue fetched: its files checked, and written as one CSV with a TOML beside it."""

import csv
import hashlib
import io
import logging
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import quote

from hysteresis import InputError
from hysteresis._atomic_file import write_whole

from .._packages import check_extra
from ._catalogue import Column, Dataset, File, Layout, config_text


def fetch(
    dataset: Dataset,
    out: Path,
    *,
    accept: bool = False,
    overwrite: bool = False,
    say: Callable[[str], None] = lambda _: None,
) -> dict[str, Any]:
    """Write `out`/NAME.csv and `out`/NAME.toml, which `hysid fit --config` takes.

    **Arguments:**

    - `accept`: take files whose checksum the catalogue does not know.
    - `overwrite`: write over files that are there.

    **Raises:** `InputError` `missing-extra`, `would-overwrite`, `no-download`, `wrong-checksum`,
    `unknown-checksum`; nothing is written then.
    """
    check_extra("datasets", "pooch")
    table, config = out / f"{dataset.name}.csv", out / f"{dataset.name}.toml"
    for file in (table, config):
        if file.exists() and not overwrite:
            said = "this file is there already, and was left as it is."
            fix = "name another folder (--out DIR), or write over it (--overwrite)."
            raise InputError("would-overwrite", said, place=str(file), fix=fix)
    seen: dict[str, dict[str, Any]] = {}
    texts = {}
    for file in dataset.files:
        address = dataset.base + quote(file.path)
        say(f"fetching {address}")
        content = _download(address)
        seen[file.path] = {"sha256": hashlib.sha256(content).hexdigest(), "bytes": len(content)}
        _check(file, address, **seen[file.path])
        texts[file] = content.decode("utf-8-sig", "replace")
    if (unknown := [file.path for file in dataset.files if not file.sha256]) and not accept:
        checksums = "; ".join(f"{path} has {seen[path]['sha256']}" for path in unknown)
        raise InputError(
            "unknown-checksum",
            f"the catalogue does not know the sha256 of {len(unknown)} of the files: {checksums}.",
            place=dataset.name,
            cause="nobody has checked these files yet; their sizes are as listed.",
            fix="compare with a source you trust, then say --accept; the checksums go into the TOML.",
        )
    written, rows = _table(dataset, texts)
    write_whole(
        config, config_text(dataset, {path: found["sha256"] for path, found in seen.items()})
    )
    write_whole(table, written)
    return {
        "name": dataset.name, "file": str(table), "config": str(config), "rows": rows,
        "sources": [{"path": path, **found} for path, found in seen.items()], "checked": not unknown,
        "licence": dataset.licence or None, "citation": dataset.citation, "notes": list(dataset.notes),
    }  # fmt: skip


def _download(address: str) -> bytes:
    import pooch

    # It tells of every download, with a checksum to copy: what we say ourselves.
    pooch.get_logger().setLevel(logging.WARNING)
    with tempfile.TemporaryDirectory(prefix="hysid-") as folder:
        try:
            return Path(pooch.retrieve(address, None, "download", folder)).read_bytes()
        except (OSError, ValueError) as error:
            raise InputError(
                "no-download",
                f"this cannot be fetched ({type(error).__name__}: {error}).",
                place=address,
                cause="no network, a proxy, or the file was taken away.",
            ) from None


def _check(file: File, address: str, sha256: str, bytes: int) -> None:
    said = cause = ""
    if file.sha256 and sha256 != file.sha256.lower():
        said = f"what came has sha256 {sha256}, and the catalogue says {file.sha256}."
        cause = "the file was changed, or the download was tampered with or cut off."
    elif file.bytes and bytes != file.bytes:
        said = f"what came has {bytes} bytes, and the catalogue says {file.bytes}."
        cause = "a download that was cut off, or a page that says why there is no file."
    if said:
        raise InputError("wrong-checksum", said, place=address, cause=cause)


def _table(dataset: Dataset, texts: dict[File, str]) -> tuple[str, int]:
    """The CSV of all files, and its number of rows."""
    layout, several = dataset.layout, len(dataset.files) > 1
    header = [column.name for column in layout.columns]
    head = ["file"] * several + [layout.blocks] * bool(layout.blocks)
    page = io.StringIO()
    writer = csv.writer(page, lineterminator="\n")
    writer.writerow([*head, *header])
    rows = 0
    for file, text in texts.items():
        blocks = _blocks(layout, text, file.path)
        samples = [cells for block in blocks for cells in block]
        numbers = [str(k) for k, block in enumerate(blocks) for _ in block]
        columns = [_column(c, [cells[c.cell] for cells in samples]) for c in layout.columns]
        for number, *values in zip(numbers, *columns, strict=True):
            own = [file.label or file.path] * several + [number] * bool(layout.blocks)
            writer.writerow([*own, *values])
        rows += len(samples)
    return page.getvalue(), rows


def _blocks(layout: Layout, text: str, place: str) -> list[list[list[str]]]:
    """The cells of the samples, by blocks; those of one line are none where blocks are numbered.

    Raises `InputError` `wrong-checksum` without samples, and for a line amid them that is none.
    """
    blocks: list[list[list[str]]] = []
    within, odd = False, 0
    for number, line in enumerate(text.splitlines(), 1):
        cells = line.split()
        if layout.separator:
            row = next(csv.reader([line], delimiter=layout.separator), [])
            cells = [cell.strip() for cell in row]
        if len(cells) != layout.cells or not all(_is_number(cells[c.cell]) for c in layout.columns):
            within = False
            odd = odd or (number if blocks and line.strip() else 0)
            continue
        if odd:
            raise _not_as_listed(f"line {odd} is no sample, and samples follow it", place)
        if not within:
            blocks.append([])
        blocks[-1].append(cells)
        within = True
    if layout.blocks:
        blocks = [block for block in blocks if len(block) > 1]
    if not blocks:
        raise _not_as_listed(f"no line has {layout.cells} cells with numbers where wanted", place)
    return blocks


def _column(column: Column, cells: list[str]) -> list[str]:
    """Numbers as the file has them where nothing is done to them."""
    if column.missing is not None:
        cells = ["" if float(cell) == column.missing else cell for cell in cells]
    if column.scale == 1 and column.zero == 0:
        return cells
    zero = float(next(filter(None, cells), 0)) if column.zero == "first" else float(column.zero)
    moved = ((column.scale * (float(cell) - zero)) if cell else None for cell in cells)
    return ["" if x is None else f"{x + 0.0:.10g}" for x in moved]


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _not_as_listed(what: str, place: str) -> InputError:
    return InputError(
        "wrong-checksum",
        f"{what}.",
        place=place,
        cause="the file is laid out otherwise than the catalogue says.",
        fix="mend [dataset.read] of the catalogue, and name it: --catalogue FILE.",
    )
