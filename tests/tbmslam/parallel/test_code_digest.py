import sys

from tbmslam.parallel.code_digest import code_digest


def test_another_source_is_another_digest(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    seen = set()
    for text in ("x = 1\n", "x = 2\n"):
        (tmp_path / "sample_code").mkdir(exist_ok=True)
        (tmp_path / "sample_code" / "__init__.py").write_text(text)
        code_digest.cache_clear()
        seen |= {code_digest("sample_code"), code_digest("sample_code")}
    sys.modules.pop("sample_code")
    assert len(seen) == 2
    code_digest.cache_clear()
