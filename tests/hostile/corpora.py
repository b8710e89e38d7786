"""All corpora: each module of this folder that has some is named here."""

from . import models, packages

CORPORA = [*packages.CORPORA, *models.CORPORA]
