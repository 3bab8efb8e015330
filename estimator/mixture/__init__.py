"""The mixture Kalman filter: Gaussians over temperatures, unmeasured heat and parameters, mixed over noise levels."""
