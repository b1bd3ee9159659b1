"""The generated files are those of the OpenAPI document of this commit."""

import subprocess
import sys
from pathlib import Path

from conftest import REPOSITORY

PACKAGE = REPOSITORY / "clients/python/src/plumbline_client"


def test_models_and_resources_are_those_of_the_document(tmp_path: Path) -> None:
    generate = [sys.executable, str(REPOSITORY / "clients/python/scripts/generate.py")]
    subprocess.run([*generate, str(REPOSITORY / "openapi/plumbline.json"), str(tmp_path)], check=True)
    for name in ("models.py", "resources.py", "async_resources.py"):
        assert (tmp_path / name).read_text() == (PACKAGE / name).read_text(), f"{name}: run scripts/generate.py"
