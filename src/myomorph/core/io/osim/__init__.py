"""OpenSim's files: models read and written, setups of its tools, task sets, marker sets, actuators.

Names, units and defaults of OpenSim's XML end here. Running a tool's setup is the work of
`opensim_tools`.
"""
