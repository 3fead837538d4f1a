"""The Python of the book's page works."""

import re
import shutil

from conftest import EXAMPLE, ROOT


def test_every_block_of_the_page_runs(tmp_path, monkeypatch, capsys):
    page = (ROOT / "docs" / "how-to" / "python.md").read_text()
    blocks = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    assert len(blocks) >= 4
    shutil.copytree(EXAMPLE, tmp_path / "example")
    monkeypatch.chdir(tmp_path)
    names = {}
    for block in blocks:
        exec(compile(block, "docs/how-to/python.md", "exec"), names)
    printed = capsys.readouterr().out
    assert "(" in printed and "ok" in printed and "complete" in printed
