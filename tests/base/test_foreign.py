"""Files of MATLAB, Octave, scipy, numpy, h5py and pyarrow: their numbers, omitted entries, and messages on damage."""

import io
import os
import struct
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
import scipy.io
import scipy.sparse

from tests.conftest import heavy
from tests.hostile.unpacked import element
from vdfmu.base import foreign
from vdfmu.base.errors import StorageError, UsageError
from vdfmu.base.foreign import read_arrow, read_foreign

FILES = Path(__file__).with_name("files")
OF_MATLAB = Path(scipy.io.__file__).with_name("matlab") / "tests/data"
"""Files that MATLAB 4 to 7.4 wrote, of the tests of scipy, if they are installed."""


def test_a_file_of_octave_is_read_for_its_numbers_and_nothing_vanishes():
    """Versions 4 and 6 have no cells or texts here: Octave 7 pads its texts of version 6 wrongly."""
    expected = {
        "time": np.arange(6.0)[:, None], "q": np.arange(1.0, 13.0).reshape(2, 6), "z": np.array([[1 + 2j]]),
        "sp": np.array([[5.0, 0, 0], [0, 0, 6.0]]), "b": np.array([[1.0]]), "i8": np.array([[-3.0, 4.0]]),
        "rec.pos": np.arange(1.0, 13.0).reshape(2, 6), "e": np.empty((0, 0)), "after": np.array([[7.0]]),
    }  # fmt: skip
    for name, lacks in (("v7", ()), ("v6", ("e",)), ("v4", ("sp", "b", "i8", "rec.pos", "e"))):
        content = read_foreign(FILES / f"octave_{name}.mat")
        assert set(content.arrays) == set(expected) - set(lacks)
        for key, values in content.arrays.items():
            np.testing.assert_array_equal(values, expected[key])
    content = read_foreign(FILES / "octave_v7.mat")
    assert content.texts == {"s": "ab\ncd", "rec.name": "x"}
    assert content.left_out == ["c (a cell array)", "sa (an array of structs)"]
    assert content.listed().endswith("; ignored: c (a cell array), sa (an array of structs)")


@pytest.mark.skipif(not OF_MATLAB.is_dir(), reason="this scipy has no files of MATLAB")
def test_files_that_matlab_wrote():
    content = read_foreign(OF_MATLAB / "some_functions.mat")
    assert list(content.arrays) == ["a", "b", "c"]
    assert content.left_out == [f"{name} (a function handle)" for name in ("sqr", "parabola", "nCf")]
    content = read_foreign(OF_MATLAB / "testobject_7.4_GLNX86.mat")
    assert "testobject.version" in content.arrays and content.texts["testobject.expr"] == "x"
    theta = np.linspace(0, 2 * np.pi, 9)[None]
    for name in ("testdouble_4.2c_SOL2", "testdouble_7.4_GLNX86", "testhdf5_7.4_GLNX86"):
        np.testing.assert_allclose(read_foreign(OF_MATLAB / f"{name}.mat").arrays["testdouble"], theta / 2, rtol=1)
    for file in sorted(OF_MATLAB.glob("*.mat")):
        try:
            read_foreign(file)
        except UsageError as error:  # scipy keeps damaged files, too
            assert f"{file}: expected a MATLAB file" in str(error)


def test_a_string_array_of_matlab_leaves_the_variables_around_it(tmp_path):
    """MATLAB stores strings and tables as class 17, mxOPAQUE, which its documentation lacks."""
    box = io.BytesIO()
    scipy.io.savemat(box, {"time": np.arange(3.0), "q": np.eye(2)})
    ids = element(6, struct.pack("<II", 13, 0)) + element(5, struct.pack("<ii", 6, 1)) + element(1, b"")
    ids = element(14, ids + element(6, struct.pack("<6I", 0xDD000000, 2, 1, 1, 1, 1)))
    parts = element(1, b"text") + element(1, b"MCOS") + element(1, b"string")
    opaque = element(14, element(6, struct.pack("<II", 17, 0)) + parts + ids)
    plain = box.getvalue()
    (tmp_path / "s.mat").write_bytes(plain[:128] + opaque + plain[128:])
    content = read_foreign(tmp_path / "s.mat")
    np.testing.assert_array_equal(content.arrays["q"], np.eye(2))
    assert list(content.arrays) == ["time", "q"]
    assert content.left_out == ["objects, such as strings and tables of MATLAB"]


def test_a_file_of_version_7_3_has_classes_of_matlab(tmp_path):
    path = tmp_path / "x.mat"
    with h5py.File(path, "w", userblock_size=512) as file:

        def put(name, values, kind, **attributes):
            file[name] = values
            file[name].attrs.update({"MATLAB_class": np.bytes_(kind), **attributes})

        put("rec/q", np.arange(6.0).reshape(3, 2), "double")  # transposed, as MATLAB writes
        put("name", np.array([[120], [121]], np.uint16), "char")
        put("strings", np.array([[1, 2, 3]], np.uint32), "string", MATLAB_object_decode=3)
        put("empty", np.zeros(2, np.uint64), "double", MATLAB_empty=1)
        put("z", np.array([[(1.0, 2.0)]], [("real", "f8"), ("imag", "f8")]), "double")
        put("#refs#/a", np.ones((1, 1)), "double")
        for part, values in {"data": [5.0, 6.0], "ir": [0, 1], "jc": [0, 1, 1, 2]}.items():
            file[f"sp/{part}"] = values
        file["sp"].attrs.update({"MATLAB_class": np.bytes_("double"), "MATLAB_sparse": 2})
        file["f/function_handle"] = np.ones(3)
        file["f"].attrs["MATLAB_class"] = np.bytes_("function_handle")
        file["outside"] = h5py.ExternalLink("/etc/passwd", "x")
        file.create_dataset("bytes", (5,), "f8", external=[("/etc/passwd", 0, 40)])
        file["again"] = h5py.SoftLink("/rec/q")
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM")
    content = read_foreign(path)
    assert set(content.arrays) == {"rec.q", "z", "sp"}
    np.testing.assert_array_equal(content.arrays["rec.q"], np.arange(6.0).reshape(3, 2).T)
    np.testing.assert_array_equal(content.arrays["sp"], [[5.0, 0, 0], [0, 0, 6.0]])
    assert content.arrays["z"].item() == 1 + 2j and content.texts == {"name": "xy"}
    assert sorted(content.left_out) == [
        "again (a link)", "bytes (numbers in another file)", "f (a function handle)", "outside (a link)",
        "strings (an object)",
    ]  # fmt: skip


def test_hdf5_and_npz_files_are_read_as_they_are(tmp_path):
    values = np.arange(6, dtype=np.float32).reshape(2, 3)
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file.create_dataset("a/b", data=values, chunks=(1, 3), compression="lzf")
    np.savez(tmp_path / "x.npz", b=values, names=np.array(["x"]))
    for name, key in (("x.h5", "a.b"), ("x.npz", "b")):
        np.testing.assert_array_equal(read_foreign(tmp_path / name).arrays[key], values, strict=True)
    np.savez(tmp_path / "x.npz", b=np.array([{}], object))
    with pytest.raises(UsageError, match=r"x.npz: expected a file of numpy, .* allow_pickle=False"):
        read_foreign(tmp_path / "x.npz")


def test_columns_of_parquet_keep_their_types_and_lacking_numbers_are_nan(tmp_path):
    stamps = np.array(["2026-01-01T00:00:00.000001", "2026-01-01"], "datetime64[us]")
    table = pa.table({
        "stamp": stamps, "n": pa.array([2**60, 1]), "m": pa.array([1, None]), "on": [True, False], "x": [1.5, None],
        "who": ["a", "b"], "list": [[1.0], [2.0]],
    })  # fmt: skip
    pa.parquet.write_table(table, tmp_path / "t.parquet")
    content = read_foreign(tmp_path / "t.parquet")
    assert list(content.arrays) == ["stamp", "n", "m", "on", "x"] and content.units == {"stamp": "ns"}
    np.testing.assert_array_equal(content.arrays["stamp"], stamps.astype("datetime64[ns]").astype(np.int64))
    np.testing.assert_array_equal(content.arrays["n"], np.array([2**60, 1]))
    np.testing.assert_array_equal(content.arrays["m"], [1, np.nan])
    np.testing.assert_array_equal(content.arrays["x"], [1.5, np.nan])
    assert content.left_out == ["who (string)", "list (list<element: double>)"]
    whole = pa.ipc.open_file(read_arrow(tmp_path / "t.parquet", ["who", "n"])).read_all()
    assert whole.to_pydict() == {"who": ["a", "b"], "n": [2**60, 1]}
    same = pa.table([pa.array([1.0]), pa.array([2.0])], names=["x", "x"])
    pa.parquet.write_table(same, tmp_path / "t.parquet")
    with pytest.raises(UsageError, match="t.parquet: x: more than one column has this name"):
        read_foreign(tmp_path / "t.parquet")


def test_names_that_are_not_utf_8_and_the_damage_of_the_reviews_are_refused(tmp_path):
    """The second file aborted pyarrow in the process of the command."""
    pa.parquet.write_table(pa.table({"time": [0.0], "abcd": [1.0]}), tmp_path / "n.parquet", compression="none")
    content = (tmp_path / "n.parquet").read_bytes()
    (tmp_path / "n.parquet").write_bytes(content.replace(b"abcd", b"ab\xca\xff"))
    with pytest.raises(UsageError, match="n.parquet: expected a Parquet file, got unreadable content: "):
        read_foreign(tmp_path / "n.parquet")


@pytest.fixture
def library(tmp_path, monkeypatch):
    """Return a function that puts other code in the place of h5py, in new processes; and a file for it to read."""
    foreign._end()

    def replace(code):
        (tmp_path / "h5py.py").write_text(code)
        monkeypatch.syspath_prepend(str(tmp_path))
        path = tmp_path / "x.h5"
        path.write_bytes(bytes(8))
        return path

    yield replace
    foreign._end()


@pytest.mark.parametrize(("code", "message"), [
    *heavy(("import os; os.abort()", r"x.h5: expected a HDF5 file, but its content crashed .* \(SIGABRT")),
    ("import os; os._exit(3)", r"its content crashed the library that reads it \(exit code 3"),
    *heavy(("raise MemoryError", "the memory limit of 1536 MiB is too small")),
    ("raise ImportError('none')", r"an HDF5 file needs the package h5py, .*'pip install vdfmu\[matlab\]'"),
    ("bytearray(2**32)", "the memory limit of 1536 MiB is too small"),
])  # fmt: skip
def test_a_library_that_crashes_ends_with_a_sentence_and_the_next_file_is_read(library, tmp_path, code, message):
    if "bytearray" in code and os.uname().sysname != "Linux":
        pytest.skip("this system does not limit the address space")
    path = library(code)
    with pytest.raises(UsageError, match=message):
        read_foreign(path)
    scipy.io.savemat(tmp_path / "x.mat", {"x": 1.0})
    assert read_foreign(tmp_path / "x.mat").arrays["x"].item() == 1.0


def test_a_library_that_hangs_is_ended(library, monkeypatch):
    monkeypatch.setattr(foreign, "SECONDS", 2.0)
    with pytest.raises(UsageError, match=r"x.h5: expected a HDF5 file, but it could not be read within 2 s"):
        read_foreign(library("import time; time.sleep(60)"))


def test_one_process_reads_all_files_and_no_folder_is_left(tmp_path, monkeypatch):
    scipy.io.savemat(tmp_path / "x.mat", {"x": np.arange(3.0)})
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "t"))
    (tmp_path / "t").mkdir()
    read_foreign(tmp_path / "x.mat")
    child = foreign._READERS[0].child
    monkeypatch.setattr(foreign, "_IN_MEMORY", 0)
    content = read_foreign(tmp_path / "x.mat")
    assert foreign._READERS[0].child is child and isinstance(content.arrays["x"], np.memmap)
    assert [*(tmp_path / "t").iterdir()] == []
    np.testing.assert_array_equal(content.arrays["x"], [[0.0, 1.0, 2.0]])


def test_what_is_no_file_is_named_and_a_full_disk_is_no_fault_of_the_file(tmp_path):
    os.mkfifo(tmp_path / "pipe.mat")
    for name, why in (("pipe.mat", "a pipe, a device"), ("none.mat", "No such file")):
        with pytest.raises(UsageError, match=f"cannot read .*{name}: .*{why}"):
            read_foreign(tmp_path / name)
    scipy.io.savemat(tmp_path / "x.mat", {"x": np.arange(3.0)})
    (tmp_path / "t").mkdir()
    (tmp_path / "t/arrays").symlink_to("/dev/full")
    with pytest.raises(StorageError, match="x.mat: cannot write to the temporary folder .*: No space"):
        foreign._answer(tmp_path / "x.mat", "MATLAB file", str(tmp_path / "t"), None)


def test_a_damaged_log_is_read_or_refused_in_words(tmp_path):
    """A few of the corpus; the seed is the number of the try."""
    from tests.hostile.unpacked import damaged

    refused = 0
    for number in range(15):
        try:
            damaged(number, tmp_path)
        except UsageError:
            refused += 1
    assert refused >= 5  # the damage reaches the readers
