"""FMUs of units: model descriptions, pages, terminals, packages, and their build."""
