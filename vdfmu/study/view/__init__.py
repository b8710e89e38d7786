"""An arm in 3D in a browser, on the page of a run: a robot with sliders, and a run in progress."""
