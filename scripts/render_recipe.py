"""Renders the conda recipe for every platform and Python that it is for, as a feedstock does before it builds.

Needs the package ``py-rattler-build``; nothing is downloaded or built.
"""

from __future__ import annotations

from pathlib import Path

RECIPE = Path(__file__).resolve().parents[1] / "recipe" / "recipe.yaml"
PLATFORMS = ("linux-64", "linux-aarch64", "osx-64", "osx-arm64")
VARIANTS = """
python: ["3.11.* *_cpython", "3.12.* *_cpython", "3.13.* *_cp313", "3.14.* *_cp314"]
cxx_compiler: [gxx]
c_stdlib: [sysroot]
"""


def main() -> None:
    from rattler_build import PlatformConfig, RenderConfig, Stage0Recipe, VariantConfig

    recipe, variants = Stage0Recipe.from_file(RECIPE), VariantConfig.from_yaml(VARIANTS)
    for platform in PLATFORMS:
        for rendered in recipe.render(variants, RenderConfig(PlatformConfig(target_platform=platform))):
            package = rendered.recipe.to_dict()
            print(
                f"{package['package']['name']}-{package['package']['version']}-{package['build']['string']} {platform}"
            )
            for kind, needed in package["requirements"].items():
                print(f"  {kind}: {', '.join(needed)}")


if __name__ == "__main__":
    main()
