"""The format of results that this extra adds."""

from vdfmu.engine.results.formats import Format


def _mat() -> Format:
    from vdfmu.extras.matlab.mat_file import FORMAT  # takes long to import

    return FORMAT


FORMATS = {".mat": _mat}
