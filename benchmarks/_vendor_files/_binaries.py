"""Binary files: MATLAB, HDF5, Parquet, TDMS, spreadsheets."""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from ._variant import ANSWER, DRIVE, TIME, N, Variant

UNITS = {"force": "N", "disp": "mm"}
PAIR = ("force", "disp")


def binaries() -> Mapping[str, Variant]:
    """Variants by format and what is particular about them."""
    return {
        "MAT 5, vectors": Variant(
            _mat({"time": TIME, "force": DRIVE, "disp": ANSWER}), {"force": "", "disp": ""}, "time", PAIR,
            ".mat",
        ),
        "MAT 5, signals of Simulink": Variant(
            _mat({"out": {"time": TIME, "signals": [
                {"values": DRIVE, "label": "force"}, {"values": ANSWER, "label": "disp"}]}}),
            {"force": "", "disp": ""}, "time", PAIR, ".mat",
        ),
        "MAT 5, dSPACE": Variant(
            _mat({"rec001": {"X": [{"Name": "time", "Data": TIME, "Unit": "s"}], "Y": [
                {"Name": "force", "Data": DRIVE, "Unit": "N"},
                {"Name": "disp", "Data": ANSWER, "Unit": "mm"}]}}),
            UNITS, "time", PAIR, ".mat",
        ),
        "MAT 5, a matrix with names": Variant(
            _mat({"data": np.stack([TIME, DRIVE, ANSWER], 1),
                  "names": np.array(["time (s)", "force (N)", "disp (mm)"], object)}),
            {"force (N)": "N", "disp (mm)": "mm"}, "time (s)", ("force (N)", "disp (mm)"), ".mat",
        ),
        "MAT 7.3": Variant(_hdf5({"time": "", "force": "", "disp": ""}, matlab=True),
                           {"force": "", "disp": ""}, "time", PAIR, ".mat"),
        "HDF5, units as attributes": Variant(_hdf5({"time": "s", **UNITS}), UNITS, "time", PAIR, ".h5"),
        "HDF5, a table of records": Variant(_records, {"force": "", "disp": ""}, "time", PAIR, ".h5"),
        "Parquet, units as metadata": Variant(_parquet, UNITS, "time", PAIR, ".parquet"),
        "Parquet of pandas, dates as index": Variant(_frame, {"force (N)": "N", "disp (mm)": "mm"},
                                                     "stamp", ("force (N)", "disp (mm)"), ".parquet"),
        "TDMS, a waveform": Variant(_tdms(True), UNITS, "time", PAIR, ".tdms"),
        "TDMS, a clock of its own": Variant(_tdms(False), UNITS, "clock", PAIR, ".tdms"),
        "XLSX, notes, units, a second sheet": Variant(
            _workbook(["Test", "foam"], [], ["Zeit", "Kraft", "Weg"], ["s", "N", "mm"]),
            {"Kraft": "N", "Weg": "mm"}, "Zeit", ("Kraft", "Weg"), ".xlsx",
        ),
        "XLSX, units in the header": Variant(
            _workbook(["Time (s)", "Load (lbf)", "Extension (in)"]),
            {"Load (lbf)": "lbf", "Extension (in)": "in"}, "Time (s)", ("Load (lbf)", "Extension (in)"),
            ".xlsx",
        ),
    }  # fmt: skip


def _mat(variables: dict[str, object]) -> Callable[[Path], object]:
    def write(file: Path) -> None:
        from scipy.io import savemat  # which the library loads late too

        savemat(file, variables)

    return write


def _hdf5(units: dict[str, str], matlab: bool = False) -> Callable[[Path], object]:
    def write(file: Path) -> None:
        import h5py

        with h5py.File(file, "w", userblock_size=512 if matlab else 0) as opened:
            for (name, unit), x in zip(units.items(), (TIME, DRIVE, ANSWER), strict=True):
                made = opened.create_dataset(name, data=x[None] if matlab else x)
                if unit:
                    made.attrs["units"] = unit
                if matlab:
                    made.attrs["MATLAB_class"] = np.bytes_("double")
        if matlab:
            with file.open("r+b") as raw:
                raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Thu Nov  5 2020")

    return write


def _records(file: Path) -> None:
    import h5py

    kinds = [("time", "f8"), ("force", "f8"), ("disp", "f8")]
    rows = np.zeros(N, kinds)
    for (name, _), x in zip(kinds, (TIME, DRIVE, ANSWER), strict=True):
        rows[name] = x
    with h5py.File(file, "w") as opened:
        opened.create_dataset("run/table", data=rows)


def _parquet(file: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    units = {"time": "s", **UNITS}
    fields = [pa.field(n, pa.float64(), metadata={"unit": u}) for n, u in units.items()]
    pq.write_table(pa.table([TIME, DRIVE, ANSWER], schema=pa.schema(fields)), file)


def _frame(file: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    stamps = np.datetime64("2020-11-05T10:00:00.000000") + (1e6 * TIME).astype("timedelta64[us]")
    columns = {"force (N)": DRIVE, "disp (mm)": ANSWER, "stamp": stamps}
    pq.write_table(pa.table(columns), file)


def _tdms(waveform: bool) -> Callable[[Path], object]:
    def write(file: Path) -> None:
        from nptdms import ChannelObject, TdmsWriter

        more = {"wf_increment": 0.05, "wf_start_offset": 0.0, "wf_samples": N} if waveform else {}
        channels = [ChannelObject("run", name, x, {"unit_string": UNITS[name], **more})
                    for name, x in (("force", DRIVE), ("disp", ANSWER))]  # fmt: skip
        if not waveform:
            channels.insert(0, ChannelObject("run", "clock", TIME, {"unit_string": "s"}))
        with TdmsWriter(str(file)) as opened:
            opened.write_segment(channels)

    return write


def _workbook(*above: list[str]) -> Callable[[Path], object]:
    def write(file: Path) -> None:
        import openpyxl

        book = openpyxl.Workbook()
        first = book.worksheets[0]
        for row in above:
            first.append(row)
        for row in zip(TIME, DRIVE, ANSWER, strict=True):
            first.append([float(v) for v in row])
        other = book.create_sheet("settings")
        for row in (["Speed", 10, "mm/min"], ["Operator", "A"]):
            other.append(row)
        book.save(file)

    return write
