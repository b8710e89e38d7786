"""All corpora: each module of this folder that has some is named here."""

from . import packages

CORPORA = [*packages.CORPORA]
