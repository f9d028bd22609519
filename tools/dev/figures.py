#!/usr/bin/env python3
"""Print the figures of the package (size, cutting, repetition), or lower their limits.

    tools/dev/figures.py            figures beside their limits in tests/figures.yaml
    tools/dev/figures.py --lower    write the figures that fell as the new limits

A limit rises by hand, with a reason beside it. `tests/python/test_figures.py` compares.
"""

import ast
import re
import sys
from collections import Counter, defaultdict
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[2]
LIMITS = ROOT / "tests" / "figures.yaml"


def figures(package: Path, tests: Path) -> dict[str, float]:
    """Return the figures of the sources below two folders.

    Args:
        package: Folder of an importable package.
        tests: Folder of its tests.
    """
    sources = {file: file.read_text("utf-8") for file in sorted(package.rglob("*.py"))}
    trees = {file: ast.parse(text) for file, text in sources.items()}
    names = {}
    for file in sources:
        parts = file.relative_to(package.parent).with_suffix("").parts
        names[file] = ".".join(parts).removesuffix(".__init__")
    lines = sum(len(text.splitlines()) for text in sources.values())
    imports = functions = once = 0
    importers: dict[str, set[str]] = defaultdict(set)
    for file, tree in trees.items():
        nodes = list(ast.walk(tree))
        used = Counter(getattr(n, "id", None) or getattr(n, "attr", None) for n in nodes)
        private: Counter[str] = Counter()
        for node in nodes:
            if isinstance(node, ast.Import | ast.ImportFrom):
                imports += (node.end_lineno or node.lineno) - node.lineno + 1
                found = {alias.name for alias in node.names}
                if isinstance(node, ast.ImportFrom):
                    found = {f"{node.module}.{name}" for name in found} | {node.module or ""}
                for module in found & set(names.values()) - {names[file]}:
                    importers[module].add(names[file])
            elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                functions += 1
                if node.name.startswith("_") and not node.name.startswith("__"):
                    private[node.name] += 1
        once += sum(1 for name, count in private.items() if count == used[name] == 1)
    text = "\n".join(sources.values())
    steps = r"\b(?:simulation|sim|env|envs|users|apps?|group|vector)\.step\("
    packages = {names[file] for file in sources if file.name == "__init__.py"}
    return {
        "lines of the package": lines,
        "lines of Python tests": sum(
            len(file.read_text("utf-8").splitlines()) for file in tests.rglob("*.py")
        ),
        "imports, % of lines": round(100 * imports / lines, 1),
        "private functions used once, % of functions": round(100 * once / functions, 1),
        "modules with one importer": sum(
            len(importers[name]) == 1 for name in names.values() if name not in packages
        ),
        "places that resolve an environment": len(
            re.findall(r"\bResolvedEnv(?:\.of_user)?\(", text)
        ),
        "calls of step of simulations, users and apps": len(re.findall(steps, text)),
        "methods that name state otherwise than state_dict": len(
            re.findall(r"def (?:get_state|set_state|save_state|load_state|memory|recall)\(", text)
        ),
    }


def main() -> None:
    """Print the figures, or lower the limits to them."""
    now = figures(ROOT / "python" / "sim2vr_harness", ROOT / "tests")
    limits = yaml.safe_load(LIMITS.read_text("utf-8"))
    if "--lower" in sys.argv[1:]:
        text = LIMITS.read_text("utf-8")
        for name, value in now.items():
            if value < limits[name]["limit"]:
                limit = rf"(^{re.escape(name)}:\n  limit: )[\d.]+"
                text = re.sub(limit, rf"\g<1>{value}", text, flags=re.M)
        LIMITS.write_text(text, "utf-8")
    for name, value in now.items():
        print(f"{name}: {value:g} (limit {limits[name]['limit']:g})")


if __name__ == "__main__":
    main()
