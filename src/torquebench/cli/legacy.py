"""The commands that are still written for argparse, behind click."""

from __future__ import annotations

import os
from types import SimpleNamespace
from typing import Any

from torquebench.cli.app import command
from torquebench.cli.parameters import option, out_folder, workers


@command(example="torquebench paper --quick")
@out_folder(help="folder for the results, new or empty (default: runs/paper-UTC)")
@option("--quick", is_flag=True, help="few draws: for a look, and for continuous integration")
@workers(help="threads (default: one per core)")
def paper(workers: int | None, **options: Any) -> int:
    """Run the paper's Figs 9 to 11 and judge each of its claims.

    Everything that the claims rest on is run, on both plants.
    """
    from torquebench.cli.paper import paper as work

    return work(SimpleNamespace(workers=workers or os.cpu_count() or 1, **options))


@command(example="torquebench boundary-layer --quick")
@out_folder(help="folder for the results, new or empty (default: runs/boundary-layer-UTC)")
@option("--quick", is_flag=True, help="few draws")
@workers(help="threads (default: one per core)")
def boundary_layer(workers: int | None, **options: Any) -> int:
    """Show what a boundary layer costs: error against chattering.

    configs/paper/boundary-layer.yaml is run over a grid of phi, k and lambda.
    """
    from torquebench.cli.boundary_layer import boundary_layer as work

    return work(SimpleNamespace(workers=workers or os.cpu_count() or 1, **options))
