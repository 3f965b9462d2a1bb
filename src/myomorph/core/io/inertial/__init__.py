"""Files of inertial sensors, of several makers, as `InertialSensors`."""
