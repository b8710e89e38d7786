"""An arm in 3D in a browser, by viser: a robot with sliders, and a run in progress."""
