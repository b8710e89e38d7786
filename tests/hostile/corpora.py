"""All corpora: each module of this folder that has some is named here."""

from . import bombs, models, packages

CORPORA = [*packages.CORPORA, *bombs.CORPORA, *models.CORPORA]
