"""The readable path: the loop interpreted, the law called as the Python function it is."""

from __future__ import annotations

from torquebench.references import Reference
from torquebench.sim.calling import call_law
from torquebench.sim.closed_loop import COMPLETED, closed_loop
from torquebench.sim.job import Job
from torquebench.sim.setup import Setup


class PythonRun:
    """A run on the readable path: call it with a range of control instants to get how they ended.

    Args:
        setup: The run.
    """

    longest = 1
    """Control instants to ask for at once."""

    def __init__(self, setup: Setup) -> None:
        self.setup = setup
        self.detail = ""
        """What went wrong, when something did."""
        setup.job.q[:], setup.job.qd[:] = setup.plant.state()

    def attach(self) -> None:
        """Have the plant go on with its payload."""
        self.setup.plant.attach()  # type: ignore[attr-defined]  # only of a plant with a payload

    def __call__(self, first: int, last: int) -> int:
        """Run control instants `first` .. `last` - 1."""
        return closed_loop(self.setup.job, first, last, self._law, self._step)

    def _law(self, job: Job, k: int) -> int:
        s = self.setup
        ref = Reference(job.q_ref[k].copy(), job.qd_ref[k].copy(), job.qdd_ref[k].copy())
        tau, status, self.detail = call_law(
            s.law,
            s.gains,
            s.belief,
            k * job.control_period,
            job.measured_q.copy(),
            job.measured_qd.copy(),
            ref,
            s.memory,
        )
        if status == COMPLETED:
            job.record_tau_law[k] = tau
        return status

    def _step(self, job: Job, substeps: int, varying: int) -> None:
        plant = self.setup.plant
        plant.step(job.torque if varying else job.torque[0], substeps)
        job.q[:], job.qd[:] = plant.state()
