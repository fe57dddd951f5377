"""Every C and C++ source is as .clang-format says."""
import subprocess


def test_c_is_formatted(root):
    sources = sorted(str(p.relative_to(root)) for folder in ("libtensormass", "haptic_rt", "apps", "python", "tests") for p in (root / folder).rglob("*")
                     if p.suffix in (".c", ".h", ".cpp"))
    assert len(sources) > 300
    run = subprocess.run(["clang-format", "--dry-run", "-Werror", *sources], cwd=root, capture_output=True, text=True, timeout=400)
    wrong = sorted({line.split(":")[0] for line in run.stderr.splitlines() if "error:" in line})
    assert run.returncode == 0, f"clang-format -i {' '.join(wrong)}"


def test_wrong_format_is_detected(root, tmp_path):
    (tmp_path / "a.c").write_text("int  main( void ){return 0;}\n")
    assert subprocess.run(["clang-format", f"--style=file:{root}/.clang-format", "--dry-run", "-Werror", tmp_path / "a.c"], capture_output=True).returncode != 0
