"""Reference results of models whose solution is known, and of the models of the Reference FMUs."""

import zipfile
from dataclasses import replace

import numpy as np
import pytest

from tests.engine.reference import models
from vdfmu.engine.inspect.description import REFERENCES
from vdfmu.extras.inspect.reference import compare

LAG, VECTOR = (
    replace(model, name=f"{model.name}Exchange", kinds=("ModelExchange",)) for model in (models.LAG, models.STATE_SPACE)
)


@pytest.mark.few(2)
@pytest.mark.parametrize("factor", [1.0, 1.01])
@pytest.mark.parametrize(("model", "version"), [(LAG, "2.0"), (LAG, "3.0"), (VECTOR, "3.0")])
def test_the_check_compares_with_reference_results_of_model_exchange(built, tmp_path, model, version, factor):
    """Of x' = u - x with u = 1 it is 1 - exp(-t), of the vector x' = x + u, y = x + u it is u exp(t)."""
    path = tmp_path / "m.fmu"
    path.write_bytes(built(model, version))
    time = np.linspace(0.0, 1.0, 11)
    output, u = ("x", np.ones(1)) if model is LAG else ("y", np.array([1.0, 2.0, 3.0]))
    rows = [u * (1 - np.exp(-t) if model is LAG else np.exp(t)) * factor for t in time]

    def cells(values):
        return " ".join(map(repr, values.tolist()))

    with zipfile.ZipFile(path, "a") as archive:
        lines = [f"{t},{cells(row)}" for t, row in zip(time.tolist(), rows, strict=True)]
        archive.writestr(f"{REFERENCES}m_out.csv", "\n".join([f"time,{output}", *lines]))
        archive.writestr(f"{REFERENCES}m_in.csv", f"time,u\n0,{cells(u)}\n1,{cells(u)}\n")
    findings = compare(path)
    assert (findings.compared, findings.notes) == (["m_out.csv"], [])
    # 1e-3 is allowed; the master integrates to 1e-6
    assert [problem.rule.number for problem in findings.problems] == ([] if factor == 1.0 else ["RUN003"])


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_the_check_feeds_truth_values_and_integers_of_reference_results(built, tmp_path, version):
    path = tmp_path / "m.fmu"
    path.write_bytes(built(models.FEEDTHROUGH if version == "3.0" else models.FEEDTHROUGH_2, version))
    names = ("Boolean", "Int32")
    with zipfile.ZipFile(path, "a") as archive:
        for end, rows in (("in", ((1, 3), (0, -4), (0, -4))), ("out", ((1, 3), (1, 3), (0, -4)))):
            head = ",".join(f"{name}_{end}put" for name in names)
            lines = [f"{t},{','.join(map(str, row))}" for t, row in enumerate(rows)]
            archive.writestr(f"{REFERENCES}m_{end}.csv", "\n".join([f"time,{head}", *lines]))
    findings = compare(path)
    assert (findings.problems, findings.compared) == ([], ["m_out.csv"])
