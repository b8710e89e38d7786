"""Versions of the documentation side by side; ``test_site.py`` looks at those of a whole build."""

import json

from tests.docs.pages import loaded

PAGE = """<title>Native FMUs - vdfmu</title>
<div class="md-header__topic">
  <span class="md-ellipsis">
    vdfmu
  </span>
</div>"""


def listed(folder):
    return json.loads((folder / "versions.js").read_text(encoding="utf-8").removeprefix("var vdfmuVersions = "))


def test_a_version_is_added_and_others_stay(tmp_path):
    versions, built, folder = loaded(), tmp_path / "built", tmp_path / "site"
    for page in ("index.html", "guides/fmpy.html", "live/wall.html"):
        (built / page).parent.mkdir(parents=True, exist_ok=True)
        (built / page).write_text(PAGE)
    versions.add_version(built, folder, "0.9")
    before = (folder / "0.9/guides/fmpy.html").read_text()
    assert "<title>Native FMUs - vdfmu 0.9</title>" in before and ">0.9</button></div>" in before
    assert (folder / "0.9/live/wall.html").read_text() == PAGE  # of a run, in a frame
    versions.add_version(built, folder, "dev")
    assert "url=0.9/index.html" in (folder / "index.html").read_text()  # which was released
    (built / "guides/fmpy.html").unlink()
    versions.add_version(built, folder, "0.10")
    versions.add_version(built, folder, "dev")  # again
    assert listed(folder) == {"dev": ["index.html"], "0.10": ["index.html"], "0.9": ["guides/fmpy.html", "index.html"]}
    assert "url=0.10/index.html" in (folder / "index.html").read_text()
    assert (folder / "0.9/guides/fmpy.html").read_text() == before


def test_the_folder_of_a_version_has_no_patch_and_of_what_is_unreleased_no_number(monkeypatch):
    versions = loaded()
    monkeypatch.setattr(versions, "__version__", "1.2.3")
    assert versions.version_name("# Changelog\n\n## [1.2.3] - unreleased\n\n## [1.2.2]\n") == "dev"
    assert versions.version_name("# Changelog\n\n## [Unreleased]\n\n## [1.2.3] - 2027-01-01\n") == "dev"
    assert versions.version_name("# Changelog\n\n## [1.2.3] - 2027-01-01\n\n## [1.2.2] - unreleased\n") == "1.2"
