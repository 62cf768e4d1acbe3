"""Write requirements.lock: the exact versions, in the running environment, of all that ibrpipe and its tests need."""

import re
import sys
import tomllib
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parent.parent
HEAD = "# Exact versions for `make`; written by `make lock` from an environment in which the tests pass.\n"
#: Open3D has two packages of one version: without CUDA where there are wheels of it, the full one elsewhere
ON_LINUX = "sys_platform == 'linux' and platform_machine == 'x86_64'"
ELSEWHERE = "sys_platform != 'linux' or platform_machine != 'x86_64'"


def plain(name: str) -> str:
    """Return a package name as indexes compare it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def wanted() -> list[Requirement]:
    """Return the requirements of the project, of its tests, its docs and its build."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    extras = project["project"]["optional-dependencies"]
    texts = [*project["project"]["dependencies"], *extras["dev"], *extras["docs"], *project["build-system"]["requires"]]
    return [Requirement(text) for text in texts]


def closure(requirements: list[Requirement]) -> dict[str, str]:
    """Return name to version of all installed packages that the requirements lead to."""
    found, waiting = {}, list(requirements)
    while waiting:
        requirement = waiting.pop()
        if requirement.marker is not None and not requirement.marker.evaluate({"extra": ""}):
            continue
        version = metadata.version(requirement.name)
        if not requirement.specifier.contains(version, prereleases=True):
            raise SystemExit(f"{requirement.name} {version} is installed but {requirement} is wanted; upgrade it first")
        if plain(requirement.name) not in found:
            found[plain(requirement.name)] = version
            waiting.extend(Requirement(text) for text in metadata.requires(requirement.name) or [])
    return found


def lines(found: dict[str, str]) -> list[str]:
    """Return the lines of the lock file."""
    written = []
    for name, version in sorted(found.items()):
        if name == "open3d-cpu":
            written += [f"open3d=={version} ; {ELSEWHERE}", f"open3d-cpu=={version} ; {ON_LINUX}"]
        elif name == "libusb-package":
            written.append(f"{name}=={version} ; sys_platform == 'linux'")
        else:
            written.append(f"{name}=={version}")
    return written


if __name__ == "__main__":
    (ROOT / "requirements.lock").write_text(HEAD + "\n".join(lines(closure(wanted()))) + "\n", encoding="utf-8")
    sys.stdout.write("requirements.lock written\n")
