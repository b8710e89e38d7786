"""Random sequences of calls: no crash, nothing that the sanitizers report, no change by a call that fails, no leak.

VDFMU_FUZZ_SECONDS makes it longer than the some seconds it takes in the tests: `VDFMU_FUZZ_SECONDS=3600 pytest
tests/compiler/native/test_fuzz.py`.
"""

import os
import subprocess
import time
from pathlib import Path

import pytest

from tests.compiler.native.conftest import GCC, HERE, fuzz_program, program, run, version_flags

pytestmark = pytest.mark.heavy

SECONDS = float(os.environ.get("VDFMU_FUZZ_SECONDS", "12"))


@pytest.mark.parametrize("unit", ["plant", "feedforward"])
def test_random_calls_find_nothing(model, sanitized, tmp_path, unit, version):
    """The same calls every time, 10,000 for each seed, as many seeds as the time allows."""
    sources = model(unit, version).folder / "sources"
    target = fuzz_program(sources, sanitized(unit, version), version, tmp_path / "fuzz")
    end = time.monotonic() + SECONDS / 5.0
    seed = 0
    while seed == 0 or time.monotonic() < end:
        seed += 1
        assert run([target, 10_000, seed], ASAN_OPTIONS="detect_leaks=1", seconds=600) == "10000 calls\n"


def fuzzer(tmp_path: Path) -> str:
    clang = program("clang", "clang")
    (tmp_path / "empty.c").write_text("int LLVMFuzzerTestOneInput(void) { return 0; }\n")
    done = subprocess.run(
        [clang, "-fsanitize=fuzzer,address", "empty.c", "-o", "empty"], cwd=tmp_path, capture_output=True
    )
    if done.returncode or subprocess.run([tmp_path / "empty", "-runs=1"], capture_output=True).returncode:
        pytest.skip("needs clang with libFuzzer: apt install clang libclang-rt-dev")
    return clang


def test_calls_that_reach_new_code_find_nothing(model, tmp_path, version):
    """LibFuzzer changes inputs towards code that none has reached; VDFMU_FUZZ_CORPUS keeps them."""
    folder, target = model("plant", version).folder / "sources", tmp_path / "fuzz"
    flags = [
        "-fsanitize=fuzzer,address,undefined,float-cast-overflow", "-fno-sanitize-recover=all", "-DDISABLE_PREFIX",
        *version_flags(version),
    ]  # fmt: skip
    run([fuzzer(tmp_path), *GCC, *flags, f"-I{folder}", *sorted(folder.glob("*.c")), HERE / "fuzz.c",
         "-o", target, "-lm"], seconds=300)  # fmt: skip
    corpus = Path(os.environ.get("VDFMU_FUZZ_CORPUS", tmp_path / "corpus"))
    corpus.mkdir(parents=True, exist_ok=True)
    run([target, corpus, "-seed=1", f"-max_total_time={max(1, round(SECONDS / 5))}", "-max_len=1024", "-timeout=60",
         "-print_final_stats=1", f"-artifact_prefix={corpus.parent}/"], cwd=tmp_path,
        seconds=SECONDS + 300)  # fmt: skip
    assert len(list(corpus.iterdir())) > 50  # it did reach new code, time and again
