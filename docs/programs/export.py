"""Model and results for other programs: OpenSim, MuJoCo, spreadsheets and xarray."""

import myomorph as mm

walk = mm.sample("walk")
fit = mm.inverse_kinematics(walk.model, walk.markers)
mm.write_osim(walk.model, "walker.osim")
certificate = mm.write_mjcf(walk.model, "walker.xml")
fit.to_pandas("coordinate_value").to_csv("angles.csv")
fit.to_xarray().to_netcdf("walk.nc", engine="h5netcdf")
again = mm.read_model("walker.osim")
print(again)
print(f"MuJoCo's copy has {len(certificate.differences)} muscles and steps: {certificate.steps}")
