"""G-code programs (RS-274 as LinuxCNC reads it) to moves."""

from feedopt_core.programs.gcode.reader import read_gcode

__all__ = ["read_gcode"]
