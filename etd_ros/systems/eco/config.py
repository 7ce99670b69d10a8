"""ECO's parameters: those that its authors published for hand-crafted features (ECO-HC)."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class EcoConfig:
    """The published parameters of ECO-HC; "target" is the first box, "sample" the picture that the features see.

    Attributes:
        search_scale: side of the square search area, in square roots of the target's area.
        sample_side_min, sample_side_max: the search area is resized to a sample with a side between these (pixels).
        hog_cell, hog_dimensions: side of a cell of the oriented gradients (sample pixels), and channels kept of them.
        intensity_cell, intensity_bins, intensity_dimensions: the same for the intensity channels, made of so many
            bins of grey levels.
        interpolation_a: parameter of the cubic kernel that makes feature maps continuous.
        label_sigma: standard deviation of the desired score, in square roots of the target's area.
        window_min, window_edge: the filter's penalty in the target's middle, and at the edge of the target (both
            before squaring); it grows quadratically.
        window_threshold: Fourier coefficients of the penalty below this share of the largest are left out.
        learning_rate: weight of a new sample among the others.
        samples_max: components of the model of all samples.
        train_each_until, train_interval: the filter learns from each of the first pictures, then from one in so many.
        train_iterations: conjugate gradient iterations each time.
        first_gauss_newton, first_iterations: in the first picture, Gauss-Newton steps, and iterations in each.
        forgetting: how soon earlier search directions lose their influence, in samples at the learning rate.
        precondition_data, precondition_window, precondition_projection: weights in the preconditioner of single
            channels' energy against that of all, of the penalty against the data, and of the projection.
        projection_penalty: weight of the squared projection.
        newton_steps: steps that refine the score's peak.
        scales, scales_fine: sizes that the scale filter compares, and sizes to which it interpolates.
        scale_step: ratio of neighbouring fine sizes.
        scale_sigma: standard deviation of the desired answer, as a share of the fine sizes.
        scale_learning_rate: weight of a new picture in the scale filter.
        scale_penalty: regularisation of the scale filter.
        scale_cell: side of its cells of oriented gradients (its pixels).
        scale_area_max: pixels that it sees of the target.
    """

    search_scale: float = 4.0
    sample_side_min: float = 150.0
    sample_side_max: float = 200.0
    hog_cell: int = 6
    hog_dimensions: int = 10
    intensity_cell: int = 4
    intensity_bins: int = 6
    intensity_dimensions: int = 3
    interpolation_a: float = -0.75
    label_sigma: float = 1 / 16
    window_min: float = 1e-4
    window_edge: float = 1e-2
    window_threshold: float = 0.05
    learning_rate: float = 0.009
    samples_max: int = 30
    train_each_until: int = 10
    train_interval: int = 6
    train_iterations: int = 5
    first_gauss_newton: int = 10
    first_iterations: int = 15
    forgetting: float = 50.0
    precondition_data: float = 0.75
    precondition_window: float = 0.25
    precondition_projection: float = 40.0
    projection_penalty: float = 1e-7
    newton_steps: int = 5
    scales: int = 17
    scales_fine: int = 33
    scale_step: float = 1.02
    scale_sigma: float = 1 / 16
    scale_learning_rate: float = 0.025
    scale_penalty: float = 1e-2
    scale_cell: int = 4
    scale_area_max: float = 512.0
