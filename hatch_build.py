"""Compiles the kernel when floatplan is built or installed; where the machine has no compiler, by one from a wheel."""

from __future__ import annotations

import importlib.util
import os
import re
from functools import cached_property
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from packaging.tags import sys_tags

KERNEL = Path(__file__).parent / "floatplan" / "kernel"
ELSEWHERE = "FLOATPLAN_KERNEL_ELSEWHERE"  # set by scripts/environment, which compiles it while the dependencies come


class CustomBuildHook(BuildHookInterface):  # type: ignore[type-arg]
    """Puts the library beside the module that loads it: into a wheel, and into the checkout that is installed."""

    @cached_property
    def _building(self) -> Any:
        """The module that compiles, without the package about it, which needs what is not installed yet."""
        spec = importlib.util.spec_from_file_location("kernel_build", KERNEL / "build.py")
        assert spec is not None, "the file is there"
        assert spec.loader is not None, "and is Python"
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module

    def dependencies(self) -> list[str]:
        """Packages that compiling needs: a compiler where the machine has none."""
        building = self._building
        try:
            return [building.WHEEL] if self.target_name == "wheel" and building.compiler() is None else []
        except building.CompilerError as error:
            self.app.abort(f"floatplan cannot be installed: {error}")
            return []

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile, and say of a wheel for which platform it then is."""
        if self.target_name != "wheel":
            return
        self._building.keep_declarations()
        if version == "editable" and os.environ.get(ELSEWHERE):
            return
        try:
            if version == "editable":
                self._building.build_if_needed()
            else:
                self._building.build()
        except self._building.CompilerError as error:
            self.app.abort(f"floatplan cannot be installed: {error}")
        if version != "editable":
            here = (tag.platform for tag in sys_tags())
            platform = next(name for name in here if not name.startswith(("manylinux", "musllinux")))
            named = os.environ.get("_PYTHON_HOST_PLATFORM", platform)  # macOS, for another processor than this one
            build_data["pure_python"] = False
            build_data["tag"] = f"py3-none-{re.sub('[-.]', '_', named)}"  # without Python headers: any Python will do
