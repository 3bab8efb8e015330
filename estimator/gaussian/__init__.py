"""Filters with one Gaussian over temperatures and log parameters: EKF, UKF, and the floor of both."""
