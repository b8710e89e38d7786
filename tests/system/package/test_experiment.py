"""The default experiment and its annotations: what is written is read back, and what cannot be run is a problem."""

import dataclasses

import pytest

from tests.engine.files import check_file
from tests.engine.texts import ssd
from tests.system.package.problems import problems, write
from vdfmu.engine.package.elements import read_experiment
from vdfmu.engine.package.parse import FOREIGN
from vdfmu.engine.package.read import load_ssp
from vdfmu.engine.package.system import Experiment
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.package.structure_file import structure_file
from vdfmu.system.scenario import load_scenario


def experiment(path, attributes="", *annotations, version="1.0"):
    inner = f"<ssd:Annotations>{''.join(annotations)}</ssd:Annotations>" if annotations else ""
    return write(path, ssd("", f"<ssd:DefaultExperiment {attributes}>{inner}</ssd:DefaultExperiment>", version=version))


def ours(attributes):
    element = f'<own:Experiment xmlns:own="{FOREIGN["vdfmu"]}" {attributes}/>'
    return f'<ssc:Annotation type="org.vdfmu.experiment">{element}</ssc:Annotation>'


def osp(attributes):
    algorithm = f'<osp:Algorithm xmlns:osp="{FOREIGN["osp"]}"><osp:FixedStepAlgorithm {attributes}/></osp:Algorithm>'
    return f'<ssc:Annotation type="com.opensimulationplatform">{algorithm}</ssc:Annotation>'


@pytest.mark.parametrize("version", ["1.0", "2.0"])
@pytest.mark.parametrize(("algorithm", "adaptive"), [("jacobi", None), ("iterative", 2e-6)])
def test_what_is_written_is_read_back(algorithm, adaptive, version):
    scenario = dataclasses.replace(
        load_scenario("planar_tracking"), step=2e-3, stop=3.0, algorithm=algorithm, adaptive=adaptive
    )
    root = structure_file(SystemDescription(scenario, version=version))
    assert read_experiment(root, "x") == (Experiment(0.0, 3.0, 2e-3, algorithm, adaptive), [])


def test_annotations_of_others_are_left_alone_but_the_step_of_libcosim(tmp_path):
    path = experiment(tmp_path / "x.ssp", 'stopTime="1"', osp('baseStepSize="0.25"'))
    assert load_ssp(path).experiment == Experiment(stop=1.0, step=0.25)
    path = experiment(tmp_path / "x.ssp", "", osp('baseStepSize="0.25"'), ours('communicationStepSize="0.5"'))
    assert load_ssp(path).experiment == Experiment(step=0.5)
    other = ours('communicationStepSize="x"').replace("org.vdfmu.experiment", "com.example")
    path = experiment(tmp_path / "x.ssp", 'stopTime="1"', other, '<ssc:Annotation type="org.vdfmu.experiment"/>')
    assert load_ssp(path).experiment == Experiment(stop=1.0)


@pytest.mark.parametrize("attributes", ["", 'startTime="1"', 'stopTime="2"', 'startTime="-1" stopTime="0"'])
def test_times_may_be_left_out(tmp_path, attributes):
    read = load_ssp(experiment(tmp_path / "x.ssp", attributes)).experiment
    assert (read.start is None) == ("startTime" not in attributes)
    assert (read.stop is None) == ("stopTime" not in attributes)


@pytest.mark.parametrize(("attributes", "expected"), [
    ('stopTime="INF"', "expected a finite stopTime, got INF"),
    ('stopTime="NaN"', "expected a finite stopTime, got NaN"),
    ('startTime="-INF" stopTime="1"', "expected a finite startTime, got -INF"),
    ('startTime="3" stopTime="2"', "expected a stopTime after startTime 3 s, got 2 s"),
    ('startTime="2" stopTime="2"', "expected a stopTime after startTime 2 s, got 2 s"),
    ('stopTime="-1"', "expected a stopTime after startTime 0 s, got -1 s"),
])  # fmt: skip
@pytest.mark.parametrize("version", ["1.0", "2.0"])
def test_times_that_cannot_be_run_are_a_problem(tmp_path, attributes, expected, version):
    path = experiment(tmp_path / "x.ssp", attributes, version=version)
    (fault,) = [problem for problem in check_file(path) if "default experiment" in problem]
    assert fault.startswith("x.ssp: SystemStructure.ssd, line 1: default experiment: ")
    assert expected in fault
    if version == "1.0":
        assert problems(path) == [fault]


@pytest.mark.parametrize(("annotation", "expected"), [
    (osp('baseStepSize="0"'), "expected a positive finite baseStepSize, got 0; write a time in s"),
    (ours('communicationStepSize="fast"'), "expected a positive finite communicationStepSize, got fast"),
    (ours('algorithm="euler"'), "expected algorithm gauss-seidel, jacobi, extrapolated, iterative, got 'euler'"),
    (ours('algorithm="iterative" adaptive="2"'), "expected a positive adaptive, got 2; write a relative error"),
    (ours('algorithm="jacobi" adaptive="1e-6"'), "adaptive is for extrapolated or iterative, not for jacobi"),
])  # fmt: skip
def test_annotations_that_cannot_be_run_are_a_problem(tmp_path, annotation, expected):
    (fault,) = problems(experiment(tmp_path / "x.ssp", 'stopTime="1"', annotation))
    assert fault.startswith("x.ssp: SystemStructure.ssd, line 1: default experiment: ")
    assert expected in fault
