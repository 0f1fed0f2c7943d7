"""What a process of the studio needs, imported once: those that follow start with it."""

import floatplan.certificate.certify
import floatplan.kernel.library
import floatplan.planning.many
import floatplan.planning.planner
import floatplan.planning.repair
import floatplan.studio.work.worker  # noqa: F401
