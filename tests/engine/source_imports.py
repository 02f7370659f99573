# SPDX-License-Identifier: GPL-3.0-or-later
"""Import statements of this tree, and the files that they lead to."""

import ast
from collections.abc import Iterator
from pathlib import Path


def imported_by(path: Path, node: ast.Import | ast.ImportFrom) -> Iterator[tuple[str, Path | str, str]]:
    """Names that an import statement of a file binds, their modules, and the names there.

    Modules are files of this tree, which relative imports lead to, and names of packages of others. The name there is
    "" where it is the module itself that is bound.
    """
    for alias in node.names:
        bound = alias.asname or alias.name
        if isinstance(node, ast.Import):
            yield bound, alias.name.partition(".")[0], ""
        elif not node.level:
            yield bound, (node.module or "").partition(".")[0], alias.name
        else:
            base = path.parents[node.level - 1].joinpath(*(node.module or "").split("."))
            modules = [base / f"{alias.name}.py", base / alias.name / "__init__.py"]
            found = next(one for one in (*modules, base.with_suffix(".py"), base / "__init__.py") if one.is_file())
            yield bound, found, "" if found in modules else alias.name
