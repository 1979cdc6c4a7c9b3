"""Files that would unpack, nest or name without end are refused before they do."""

import io
import tracemalloc
import zipfile

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from hysteresis import _limits
from hysteresis._limits import DAMAGE, DEEPEST, LARGEST_TOML, load_arrays, parse_json, parse_toml

kinds = st.sampled_from(["f8", "f4", "i8", "i4", "?", "U3", "S2", "c16"])


@pytest.mark.parametrize(
    "bomb", ["[" * 10**6, '{"a":' * 10**5, "[" * 65 + "]" * 65, "[[]," * 10**5]
)
def test_nesting_has_an_end(bomb: str):
    with pytest.raises(ValueError, match=f"more than {DEEPEST} deep" if "[]" not in bomb else None):
        parse_json(bomb)


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity"])
def test_what_json_does_not_have_is_refused(number: str):
    with pytest.raises(ValueError, match=number):
        parse_json(f'{{"a": [{number}]}}')


@pytest.mark.parametrize(
    "bomb",
    [
        "a = " + "[" * 1000 + "]" * 1000, "a." * 20_000 + "b = 1", "[" + "a." * 20_000 + "b]\n",
        "x = {" + "a." * 20_000 + "b = 1}", '"a".' * 20_000 + "b = 1", "#" * (LARGEST_TOML + 1),
        "a = " + "{b = " * 1000,
    ],
)  # fmt: skip
def test_keys_and_tables_have_an_end(bomb: str):
    tracemalloc.start()
    with pytest.raises(ValueError, match=r"more than 64|the limit is 1,000,000"):
        parse_toml(bomb)
    assert tracemalloc.get_traced_memory()[1] < 50e6
    tracemalloc.stop()


@given(
    st.dictionaries(
        st.text("abc", min_size=1, max_size=3),
        hnp.arrays(kinds, hnp.array_shapes(min_dims=0, min_side=0)),
        max_size=3,
    ),
    st.booleans(),
)
def test_arrays_come_back(arrays: dict, packed: bool):
    file = io.BytesIO()
    (np.savez_compressed if packed else np.savez)(file, **arrays)
    found = load_arrays(io.BytesIO(file.getvalue()))
    assert found.keys() == arrays.keys()
    for name, array in arrays.items():
        assert found[name].dtype == array.dtype
        assert found[name].flags.writeable
        np.testing.assert_array_equal(found[name], array)


def npz(content: bytes, name: str = "a.npy") -> io.BytesIO:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as packed:
        packed.writestr(name, content)
    return file


def header(shape: str, kind: str = "<f8") -> bytes:
    text = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (header("(100000000000,)") + b"12345678", "declares 800,000,000,000 bytes"),
        (header("(3000000000, 3000000000, 3000000000)"), "declares"),
        (header("(-1,)"), "declares"),
        (header("(1,)", "|O") + b"12345678", "objects"),
        (header("(" * 900 + "1" + ",)" * 900), ""),
        (header("10**10**10"), ""),
        (header("(1,"), "cannot be read"),  # NumPy's reader of Python 2's headers raises TokenError
        (b"", ""),
        (b"\x93NUMPY\x09\x00aaaa", "version"),
    ],
)
def test_a_header_that_promises_more_is_refused(content: bytes, said: str):
    tracemalloc.start()
    with pytest.raises(DAMAGE, match=said or None):
        load_arrays(npz(content))
    assert tracemalloc.get_traced_memory()[1] < 50e6
    tracemalloc.stop()


def test_a_packed_file_does_not_unpack_to_gigabytes(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(_limits, "ALWAYS_UNPACKED", 2_000_000)
    file = io.BytesIO()
    with (
        zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as packed,
        packed.open("a.npy", "w") as to,
    ):
        to.write(header("(500000,)"))
        for _ in range(4):
            to.write(bytes(1_000_000))
    assert len(file.getvalue()) < 1e4
    with pytest.raises(
        ValueError, match=r"would unpack to 4,000,\d+ bytes, and the limit .* 2,000,000"
    ):
        load_arrays(file)
