# SPDX-License-Identifier: GPL-3.0-or-later
"""Kernels are compiled anew when a source they depend on changes."""

from volumetrics_addon.scene import compilation


def test_stale_kernels_go_and_fresh_ones_stay(tmp_path, monkeypatch):
    source = tmp_path / "source.py"
    source.write_text("A = 1")
    monkeypatch.setattr(compilation, "SOURCES", (source,))
    folder = tmp_path / "__pycache__"
    module = str(tmp_path / "kernel.py")
    assert compilation.forget_stale_kernels(module)
    (folder / "kernel.nbi").write_text("compiled")
    (folder / "module.pyc").write_text("compiled")
    assert not compilation.forget_stale_kernels(module)
    assert (folder / "kernel.nbi").exists()
    source.write_text("A = 2")
    assert compilation.forget_stale_kernels(module)
    assert sorted(p.name for p in folder.iterdir()) == ["kernels.sha256", "module.pyc"]


def test_every_source_is_there():
    assert all(source.is_file() for source in compilation.SOURCES)
