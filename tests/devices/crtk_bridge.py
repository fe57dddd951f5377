"""Runs tensormass.crtk_master from the sources: it does not need the package's library."""
import pathlib
import sys
import types

package = types.ModuleType("tensormass")
package.__path__ = [str(pathlib.Path(__file__).resolve().parents[2] / "python/tensormass")]
sys.modules["tensormass"] = package
from tensormass.crtk_master import main  # noqa: E402

if __name__ == "__main__":
    sys.exit(main())
