"""Compile C libraries with ziglang, or with gcc or clang for this machine, and load them.

Builds are reproducible: objects are compiled under relative names without debug information, and the linker's time
stamps are replaced. Objects and libraries are cached by the digest of their sources, so FMUs that differ only in start
values share the compiled equations.
"""

from __future__ import annotations

import os
import re
import struct
import subprocess
import tempfile
import time
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from contextlib import contextmanager, suppress
from ctypes import CDLL
from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256
from itertools import chain
from pathlib import Path, PurePosixPath
from threading import Lock
from typing import TypeVar

from vdfmu.base.cache import COMPILER, cache_folder, load, store, trusted
from vdfmu.base.errors import LOG, FmuError
from vdfmu.base.files import temporary_folder
from vdfmu.base.platforms import PLATFORMS, WASM, X86, Compiler, Platform, compiler, this_platform
from vdfmu.base.process import end_group
from vdfmu.base.progress import counted

_FLAGS = (
    "-std=c11", "-O3", "-ffp-contract=off", "-fno-math-errno", "-fvisibility=hidden",
    "-Wall", "-Wextra", "-I.", "-DDISABLE_PREFIX", "-g0",
)  # fmt: skip
WRITTEN = "fmu_src.c"
"""File with the common code of all units."""
_SINGLY = "-fno-slp-vectorize"
"""Disables SLP vectorisation, which takes half of the compile time of straight-line code and gains nothing at run time.
It stays on for a solver's step, which works on arrays: there it saves up to 8 %, with bit-identical results."""
_STEP = re.compile(r"(kernel_\w+_step)(_avx2)?\.c")
"""File of a solver's step, without the long functions that it calls."""
_LOOPED = "-fno-unroll-loops"
"""Keeps the loops in the step of a long arm. Unrolled, they compile in 6 s instead of 1 s and make the object three
times as large, and a step saves only 2 to 4 % of its time, with bit-identical results."""
_LOOP = b"for (int j = 0;"
"""Start of a loop over joints, see :func:`vdfmu.compiler.c.rolled.rolled`."""
_JOINED = re.compile(r"(kernel_\w+|rows|unit)(?<!_avx2)\.c")
"""Generated file that may be part of an object."""
_SHORT = 5_000
"""Most characters of a traced function that is part of an object with others, if it is not rare."""
_RARE = re.compile(r"kernel_\w+_(forward|reverse)\.c|rare\.c")
_QUICKLY = ("-O0", "-fno-sanitize=undefined", "-fno-stack-protector")
"""For code that rarely runs: derivatives, and the step for processors from before 2015 if there is a copy of it for
AVX2. Optimised, it would run twice as fast, but take three times as long to compile. The runner of tables of
derivatives is always optimised, because otherwise a run of a long arm took 35 % longer."""
_STRAIGHT = re.compile(r"kernel_(?!\w*_step)\w+\.c")
"""File of a traced function outside of a solver's step."""
_LESS = ("-Xclang", "-O1")
"""For long functions without loops: compiled in three quarters of the time, a call takes 1 % longer. In a solver's step
it would be 10 %, so there it is not chosen. Zig takes -O1 for -O2."""
_COMPACT = ("-fno-inline-functions", "-fno-vectorize")
"""For the common code of all units, without long loops."""
_ROOM = "Free space there, or set TMPDIR and VDFMU_CACHE_DIR to other folders."
_CODE = (b"\x7fELF", b"\xcf\xfa\xed\xfe", b"MZ", b"\x64\x86", b"\0asm")
"""First bytes of libraries and objects on Linux, macOS, Windows (objects for x86-64) and WebAssembly."""
_INCLUDE = re.compile(rb'^\s*#\s*include\s*["<]([^">]+)[">]', re.MULTILINE)
SHOWN = """#ifdef _WIN32
#define SHOWN __declspec(dllexport)
#else
#define SHOWN __attribute__((visibility("default")))
#endif
"""
"""C definition of the attribute of functions that Python calls."""
_Library = TypeVar("_Library", bound=CDLL)


@dataclass(frozen=True)
class Compilation:
    """A library to make from C files and headers, with its model name."""

    name: str
    sources: Mapping[str, bytes]
    platform: str
    """Name in :data:`~vdfmu.base.platforms.PLATFORMS`."""
    flags: tuple[str, ...] = ()
    """Additional flags of the compiler and the linker."""
    zig: bool = False
    """Whether the sources need zig on this machine too."""

    @property
    def target(self) -> Platform:
        """The library's platform."""
        return PLATFORMS[self.platform]

    @property
    def compiler(self) -> Compiler:
        """The library's compiler."""
        return compiler("" if self.zig else self.platform)

    @cached_property
    def files(self) -> dict[str, bytes]:
        """Text of the C file of each object.

        Starting the compiler takes as long as compiling a short function, so short files form one object, and rare code
        another. Each long function has its own object, so that they compile in parallel and references find them in the
        cache.
        """
        files: dict[str, bytes] = {}
        for name, text in sorted(self.sources.items()):
            is_rare = self._is_rare(name)
            whole = "rare.c" if is_rare else "together.c"
            is_short = is_rare or len(text) <= _SHORT or not name.startswith("kernel_")
            if _JOINED.fullmatch(name) and is_short and self.flags_of(name) == self.flags_of(whole):
                files[whole] = files.get(whole, b"") + f'#include "{name}"\n'.encode()
            elif name.endswith(".c"):
                files[name] = text
        return files

    @cached_property
    def objects(self) -> dict[str, str]:
        """Key of the object of each C file of :attr:`files`."""
        how = {name: f"object {self.target.target} {' '.join(self.flags_of(name))}" for name in self.files}
        return {name: self._key(how[name], self.needed(name)) for name in self.files}

    def flags_of(self, name: str) -> list[str]:
        """Return the compiler's flags for a C file."""
        step = _STEP.fullmatch(name)
        chosen = () if step else (_SINGLY,)
        if step and _LOOP in self.sources[f"{step[1]}.c"]:
            chosen = (_LOOPED,)
        if self._is_rare(name):
            chosen = _QUICKLY
        elif name == WRITTEN:
            chosen += _COMPACT
        elif _STRAIGHT.fullmatch(name) and len(text := self.sources[name]) > _SHORT and b" for (" not in text:
            chosen += _LESS
        return [*_FLAGS, *chosen, *self.target.flags, *self.flags]

    def _is_rare(self, name: str) -> bool:
        has_copy = self.target.flags == X86 and name.replace(".c", "_avx2.c") in self.sources
        return has_copy or bool(_RARE.fullmatch(name))

    def needed(self, name: str) -> dict[str, bytes]:
        """Return a file and the sources that it includes, directly or indirectly."""
        sources, needed = {**self.sources, **self.files}, dict[str, bytes]()
        names = [name]
        while names:
            if (file := names.pop()) not in needed and file in sources:
                needed[file] = sources[file]
                names += [header.decode() for header in _INCLUDE.findall(needed[file])]
        return needed

    @cached_property
    def key(self) -> str:
        """Key of the library."""
        how = [repr(self.target), *self.objects.values()]
        return self._key(f"library {' '.join(how)}", self.sources)

    def _key(self, kind: str, files: Mapping[str, bytes]) -> str:
        digest = sha256(repr((kind, self.compiler.identity, self.flags)).encode())
        for name, text in sorted(files.items()):
            digest.update(f"\n{name} {len(text)}\n".encode())
            digest.update(text)
        return digest.hexdigest()


def compile_library(sources: Mapping[str, bytes], platform: str, *, name: str, flags: Sequence[str] = ()) -> bytes:
    """Return a shared library; see :func:`compile_libraries`."""
    return compile_libraries([Compilation(name, sources, platform, tuple(flags))])[0]


def _machine_code(content: bytes) -> bytes:
    """Return a library or an object file; ValueError for anything else."""
    if not content.startswith(_CODE):
        raise ValueError("no machine code")
    return content


def compile_libraries(jobs: Iterable[Compilation]) -> list[bytes]:
    """Return the shared library of each job, from the cache or compiled on all processors.

    A job is compiled while the iterator makes the next one. FmuError if the compiler is not installed or rejects a
    file, or if the disk is full.
    """
    libraries: dict[int, bytes] = {}

    def missing() -> Iterator[tuple[int, Compilation]]:
        for i, job in enumerate(jobs):
            if (library := load(_stored(job.key), _machine_code)) is None:
                yield i, job
            else:
                libraries[i] = library

    new = missing()
    try:
        if (first := next(new, None)) is not None:
            with temporary_folder("vdfmu_native_") as folder:
                for i, (key, library) in _Workshop(folder).make(chain([first], new)).items():
                    store(_stored(key), library)
                    libraries[i] = library
    except OSError as error:
        where = error.filename or tempfile.gettempdir()
        raise FmuError(f"the native FMUs cannot be compiled: {where}: {error.strerror}. {_ROOM}") from error
    return [libraries[i] for i in sorted(libraries)]


def _stored(key: str) -> Path:
    """Return the file of an object or a library in the cache."""
    return cache_folder() / "native" / key


def support_folder(spare: Path) -> str:
    """Return the folder for zig's own libraries of each platform, with zig's locks. Without a cache it is in `spare`.

    No other program uses this subfolder, because zig would reuse libraries made under other environment variables.
    """
    chosen, cache = os.environ.get("ZIG_GLOBAL_CACHE_DIR"), cache_folder()
    folder = (Path(chosen) if chosen and trusted(Path(chosen)) else cache / COMPILER) / "vdfmu"
    try:
        for made in (cache, folder.parent, folder):
            made.mkdir(parents=True, exist_ok=True, mode=0o700)
        with tempfile.TemporaryFile(dir=folder):
            return str(folder)
    except OSError:
        return str(spare / "zig_support")


class _Workshop:
    """Folders of jobs, and the processes of the compiler."""

    def __init__(self, folder: str) -> None:
        self._folder = Path(folder)
        self._running: set[subprocess.Popen[bytes]] = set()
        self._stopped = False
        self._lock = Lock()
        self._folders = dict.fromkeys(("TMPDIR", "TMP", "TEMP"), folder) | {
            "ZIG_LOCAL_CACHE_DIR": str(self._folder / "zig"),
            "ZIG_GLOBAL_CACHE_DIR": support_folder(self._folder),
        }
        """Variables with the folders in which a compiler may write."""

    def make(self, jobs: Iterable[tuple[int, Compilation]]) -> dict[int, tuple[str, bytes]]:
        """Make libraries. Return key and library for the number of each job."""
        places: dict[int, tuple[Compilation, Path]] = {}
        objects: dict[str, Path] = {}  # by key, of all jobs
        with self._pool() as pool:
            tasks: list[Future[None]] = []
            for i, job in jobs:
                place = self._folder / str(i)
                place.mkdir()
                for name, text in {**job.sources, **job.files}.items():
                    (place / name).write_bytes(text)
                places[i] = job, place
                tasks += self._compile(pool, job, place, objects)
            for task in counted("compile", as_completed(tasks), len(tasks)):
                task.result()
            links = {i: pool.submit(self._link, *where, objects) for i, where in places.items()}
            return {i: (places[i][0].key, link.result()) for i, link in links.items()}

    @contextmanager
    def _pool(self) -> Generator[ThreadPoolExecutor]:
        """Yield the threads that wait for the compiler's processes. An error or an interrupt ends the processes."""
        with ThreadPoolExecutor(max_workers=os.cpu_count() or 1) as pool:
            try:
                yield pool
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                self._stop()
                raise

    def _compile(
        self, pool: ThreadPoolExecutor, job: Compilation, place: Path, objects: dict[str, Path]
    ) -> list[Future[None]]:
        """Start to compile the objects that no earlier job makes, the longest first."""
        missing: list[tuple[str, str]] = []
        for name, key in job.objects.items():
            if key in objects:
                continue
            objects[key] = place / f"{PurePosixPath(name).stem}.o"
            stored = load(_stored(key), _machine_code)
            if stored is None:
                missing.append((name, key))
            else:
                objects[key].write_bytes(stored)
        missing.sort(key=lambda item: -sum(map(len, job.needed(item[0]).values())))
        return [pool.submit(self._object, job, place, *item) for item in missing]

    def _object(self, job: Compilation, place: Path, name: str, key: str) -> None:
        file = f"{PurePosixPath(name).stem}.o"
        self._run(job, place, name, ["-c", *job.flags_of(name), "-o", file, name])
        store(_stored(key), (place / file).read_bytes())

    def _link(self, job: Compilation, place: Path, objects: Mapping[str, Path]) -> bytes:
        files = [os.path.relpath(objects[key], place) for key in job.objects.values()]
        library = f"{job.name}{job.target.suffix}"
        extra = self._system_libraries(job)
        # otherwise the name in the library would include the temporary folder
        if job.platform.endswith("darwin"):
            extra.append(f"-Wl,-install_name,@rpath/{library}")
        if job.platform == WASM:
            extra.append("-Wl,--export-dynamic")
        self._run(job, place, library, [*job.target.link, "-s", *job.flags, "-o", library, *files, *extra])
        return _without_time((place / library).read_bytes())

    def _system_libraries(self, job: Compilation) -> list[str]:
        """Return linker arguments for stubs of the system's libraries, which define the names but have no code.

        Without them zig would first spend 7 s on compiling its own, to find the library of each function.
        """
        if not job.compiler.is_zig:
            return ["-lm"]
        if not job.target.libraries:
            return []
        folder = self._folder / job.platform
        with self._lock:
            folder.mkdir(exist_ok=True)
            for file, versions in job.target.libraries.items():
                if (folder / file).exists():
                    continue
                names = [name for functions in versions.values() for name in functions.split()]
                sources = {
                    "names.s": "".join(f".globl {n}\n.type {n}, %function\n{n}:\n" for n in names).encode(),
                    "versions": "".join(f"{v} {{ {f.replace(' ', '; ')}; }};\n" for v, f in versions.items()).encode(),
                }
                flags = ("-shared", "-nostdlib", f"-Wl,-soname,{file}", "-Wl,--version-script=versions")
                path = _stored(Compilation(file, sources, job.platform, flags).key)
                if (stored := load(path, _machine_code)) is not None:
                    (folder / file).write_bytes(stored)
                    continue
                for name, text in sources.items():
                    (folder / name).write_bytes(text)
                self._run(job, folder, file, [*flags, "-o", file, "names.s"])
                store(path, (folder / file).read_bytes())
        return ["-nostdlib", "-Wl,--as-needed,-z,defs", *(str(folder / file) for file in job.target.libraries)]

    def _run(self, job: Compilation, place: Path, product: str, arguments: Sequence[str]) -> None:
        command = [*job.compiler.command, *job.compiler.arguments(job.target, arguments)]
        # a process in a new session does not get Ctrl-C, and its children end with it
        environment, began = {**job.compiler.environment, **self._folders}, time.perf_counter()
        process = subprocess.Popen(
            command, cwd=place, env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE, start_new_session=os.name == "posix",
        )  # fmt: skip
        self._running.add(process)
        if self._stopped:
            self._stop()
        try:
            _, output = process.communicate()
        finally:
            self._running.discard(process)
        if process.returncode == 0:
            LOG.info(
                "%s: %s: %.2f s", job.name, " ".join([Path(command[0]).name, *command[1:]]), time.perf_counter() - began
            )
            return
        words = output.decode("utf-8", "replace")
        full = "NoSpaceLeft" in words or "No space left" in words
        spare = str(self._folder / "zig_support")
        if full and environment["ZIG_GLOBAL_CACHE_DIR"] != spare:  # without the cache it just takes longer
            self._folders = self._folders | {"ZIG_GLOBAL_CACHE_DIR": spare}
            return self._run(job, place, product, arguments)
        errors = "\n".join(line for line in words.splitlines() if line and not line.startswith("warning(zcu)"))
        hint = f" {_ROOM}" if full else ""
        raise FmuError(f"{job.name} for {job.platform}: {product} cannot be compiled:\n{errors}{hint}")

    def _stop(self) -> None:
        self._stopped = True
        for process in list(self._running):
            end_group(process)


def _without_time(library: bytes) -> bytes:
    """Return a library without the time stamp in the header of Windows libraries."""
    if library[:2] != b"MZ":
        return library
    (header,) = struct.unpack_from("<I", library, 0x3C)
    return library[: header + 8] + bytes(4) + library[header + 12 :]


def loaded(files: Mapping[str, bytes], name: str, kind: type[_Library] = CDLL) -> _Library:
    """Compile C files, or find their library `name` in the cache, and load it.

    `kind`: functions of a `CDLL` release the interpreter's lock for other threads. Short functions take less time than
    that, so use `PyDLL` for them. FmuError without a compiler or disk space.
    """
    return load_library(compile_library(files, this_platform(), name=name), name, kind)


def own_library(source: Path) -> CDLL | None:
    """Load the library of a C file of the package; None without a compiler or disk space."""
    with suppress(FmuError):
        return loaded({source.name: SHOWN.encode() + source.read_bytes()}, source.stem)
    return None


def load_library(library: bytes, name: str, kind: type[_Library] = CDLL) -> _Library:
    """Load a compiled library of this platform. FmuError if the disk is full."""
    with temporary_folder("vdfmu_library_") as folder:
        path = Path(folder) / f"{name}{PLATFORMS[this_platform()].suffix}"
        try:
            path.write_bytes(library)
        except OSError as error:
            raise FmuError(f"{path}: cannot be written: {error.strerror or error}. {_ROOM}") from None
        return kind(str(path))
