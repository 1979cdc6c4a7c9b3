"""A data set of the catalogue fetched: its files checked, and written as one CSV with a TOML beside it."""

import csv
import hashlib
import io
import logging
import tempfile
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

from .._packages import check_extra
from ._catalogue import Column, Dataset, File, Layout, config_text, input_error


class _Sample(NamedTuple):
    block: int
    cells: list[str]


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
            raise input_error("would-overwrite", said, place=str(file), fix=fix)
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
        raise input_error(
            "unknown-checksum",
            f"the catalogue does not know the sha256 of {len(unknown)} of the files: {checksums}.",
            place=dataset.name,
            cause="nobody has checked these files yet; their sizes are as listed.",
            fix="compare with a source you trust, then say --accept; the checksums go into the TOML.",
        )
    written, rows = _table(dataset, texts)
    out.mkdir(parents=True, exist_ok=True)
    # hysteresis brings JAX, which the commands on data sets do without until there is a file to write.
    from hysteresis._atomic_file import write_whole

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
    logger, level = pooch.get_logger(), pooch.get_logger().level
    logger.setLevel(logging.WARNING)
    with tempfile.TemporaryDirectory(prefix="hysid-") as folder:
        try:
            return Path(pooch.retrieve(address, None, "download", folder)).read_bytes()
        except (OSError, ValueError) as error:
            raise input_error(
                "no-download",
                f"this cannot be fetched ({type(error).__name__}: {error}).",
                place=address,
                cause="no network, a proxy, or the file was taken away.",
            ) from None
        finally:
            logger.setLevel(level)


def _check(file: File, address: str, sha256: str, bytes: int) -> None:
    said = cause = ""
    if file.sha256 and sha256 != file.sha256.lower():
        said = f"what came has sha256 {sha256}, and the catalogue says {file.sha256}."
        cause = "the file was changed, or the download was tampered with or cut off."
    elif file.bytes and bytes != file.bytes:
        said = f"what came has {bytes} bytes, and the catalogue says {file.bytes}."
        cause = "a download that was cut off, or a page that says why there is no file."
    if said:
        raise input_error("wrong-checksum", said, place=address, cause=cause)


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
        samples = _samples(layout, text, file.path)
        columns = [_column(c, [s.cells[c.cell] for s in samples]) for c in layout.columns]
        for sample, *values in zip(samples, *columns, strict=True):
            own = [file.label or file.path] * several + [str(sample.block)] * bool(layout.blocks)
            writer.writerow([*own, *values])
        rows += len(samples)
    return page.getvalue(), rows


def _samples(layout: Layout, text: str, place: str) -> list[_Sample]:
    """Raises `InputError` `wrong-checksum` without samples, and for a line amid them that is none."""
    found: list[_Sample] = []
    block, within, odd = -1, False, 0
    for number, line in zip(count(1), text.splitlines()):
        cells = _cells(line, layout.separator)
        if len(cells) != layout.cells or not all(_is_number(cells[c.cell]) for c in layout.columns):
            within = False
            odd = odd or (number if found and line.strip() else 0)
            continue
        if odd:
            raise _not_as_listed(f"line {odd} is no sample, and samples follow it", place)
        block, within = block + (not within), True
        found.append(_Sample(block, cells))
    if layout.blocks:
        found = list(_numbered(found))
    if not found:
        raise _not_as_listed(f"no line has {layout.cells} cells with numbers where wanted", place)
    return found


def _cells(line: str, separator: str) -> list[str]:
    if not separator:
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator), [])]


def _numbered(samples: list[_Sample]) -> Iterator[_Sample]:
    """Without the blocks of one line, the others numbered from 0."""
    sizes: dict[int, int] = {}
    for sample in samples:
        sizes[sample.block] = sizes.get(sample.block, 0) + 1
    kept = [block for block, size in sizes.items() if size > 1]
    place = {block: k for k, block in enumerate(kept)}
    return (_Sample(place[s.block], s.cells) for s in samples if s.block in place)


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


def _not_as_listed(what: str, place: str) -> Exception:
    return input_error(
        "wrong-checksum",
        f"{what}.",
        place=place,
        cause="the file is laid out otherwise than the catalogue says.",
        fix="mend [dataset.read] of the catalogue, and name it: --catalogue FILE.",
    )
