"""Parameter sections of simulated routers that the tests vary."""

from __future__ import annotations

from typing import Any

import pytest


@pytest.fixture
def section() -> dict[str, Any]:
    """Two axes: drives of the thesis' simulation study (table 3-1), ideal encoder, no unmodelled effect."""
    return {
        "axis_names": ["X", "Y"],
        "servo_period_s": 0.001,
        "substeps": 10,
        "seed": 1,
        "controller": "p_pi",
        "inertia_volts_s2_mm": [2.13e-3, 1.25e-3],
        "viscous_volts_s_mm": [4.67e-2, 3.80e-2],
        "offset_volts": [0.148, 0.0119],
        "coulomb_positive_volts": [0.241, 0.131],
        "coulomb_negative_volts": [0.241, 0.131],
        "saturation_volts": [10.0, 10.0],
        "static_friction_ratio": [1.0, 1.0],
        "stribeck_velocity_mm_s": [2.0, 2.0],
        "ripple_volts": [0.0, 0.0],
        "lead_error_mm": [0.0, 0.0],
        "screw_pitch_mm": [10.0, 10.0],
        "backlash_mm": [0.0, 0.0],
        "mode_frequency_hz": [60.0, 60.0],
        "mode_damping_ratio": [0.02, 0.02],
        "mode_inertia_ratio": [0.0, 0.0],
        "encoder_resolution_mm": [0.0, 0.0],
        "encoder_noise_mm": [0.0, 0.0],
        "model_inertia_volts_s2_mm": [2.13e-3, 1.25e-3],
        "model_viscous_volts_s_mm": [4.67e-2, 3.80e-2],
        "model_offset_volts": [0.148, 0.0119],
        "model_coulomb_positive_volts": [0.241, 0.131],
        "model_coulomb_negative_volts": [0.241, 0.131],
        "velocity_filter_s": [0.001, 0.001],
        "in_position_window_mm": [1.0 / 384.0, 1.0 / 384.0],
        "position_gain_per_s": [80.0, 80.0],
        "velocity_gain_volts_s_mm": [0.426, 0.25],
        "velocity_integral_per_s": [60.0, 60.0],
        "error_velocity_gain_s": [4.49e-5, 8.07e-5],
        "error_acceleration_gain_s2": [1.99e-5, 1.52e-6],
        "error_jerk_gain_s3": [5.20e-8, 1.80e-8],
        "sliding_bandwidth_rad_s": [100.0, 100.0],
        "sliding_gain_volts_s_rad": [1.0, 1.0],
        "adaptation_gain_volts_rad": [100.0, 100.0],
        "disturbance_limit_volts": [5.0, 5.0],
        "transmission_mm_rad": [1.6977, 1.6977],
    }


@pytest.fixture
def unmodelled() -> dict[str, Any]:
    """Everything the drive model leaves out, switched on."""
    return {
        "static_friction_ratio": [1.3, 1.2],
        "ripple_volts": [0.1, 0.05],
        "lead_error_mm": [0.005, 0.005],
        "backlash_mm": [0.01, 0.01],
        "mode_inertia_ratio": [0.25, 0.25],
        "mode_frequency_hz": [45.0, 80.0],
        "mode_damping_ratio": [0.03, 0.03],
    }
