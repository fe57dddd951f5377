"""Builds one wheel per platform for every Python: ctypes opens the libraries, so they do not depend on an interpreter. TM_PYTHON_LIB: a folder of
libraries that are already built; otherwise `make python-libraries` builds them (Debian packages: tools/packages/build.txt)."""
import os
import pathlib
import re
import shutil
import subprocess
import sys

from setuptools import Distribution, setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_py import build_py

HERE = pathlib.Path(__file__).resolve().parent


class WithLibraries(build_py):
    def run(self):
        super().run()
        package = pathlib.Path(self.build_lib) / "tensormass"
        lib = os.environ.get("TM_PYTHON_LIB")
        if not lib:
            subprocess.run(["make", f"-j{os.cpu_count() or 1}", "python-libraries"], cwd=HERE, check=True)
            lib = HERE / "build/python-lib"
        for folder in ("lib", "lcm_types"):
            shutil.rmtree(package / folder, ignore_errors=True)
            (package / folder).mkdir(parents=True)
        for found in pathlib.Path(lib).glob("libtensormass*"):
            shutil.copy2(found, package / "lib")
        for found in (HERE / "lcm_types").glob("*.lcm"):
            shutil.copy2(found, package / "lcm_types")
        headers = re.search(r"^PYTHON_HEADERS := (.*?[^\\])$", (HERE / "python/module.mk").read_text(), re.M | re.S)[1].replace("\\\n", " ").split()
        subprocess.run([sys.executable, "python/bind.py", package.resolve() / "_bind.py", os.environ.get("CC", "cc"), "libtensormass/include",
                        "libtensormass/io/include", "libtensormass/scene/include", "haptic_rt/core", "--", *headers], cwd=HERE, check=True)


class ForEveryPython(bdist_wheel):
    def get_tag(self):
        return "py3", "none", super().get_tag()[2]


class WithBinaries(Distribution):
    def has_ext_modules(self):
        return True


VERSION = re.search(r"^VERSION := (\S+)$", (HERE / "Makefile").read_text(), re.M)[1]
setup(version=VERSION, cmdclass={"build_py": WithLibraries, "bdist_wheel": ForEveryPython}, distclass=WithBinaries)
