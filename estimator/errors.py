"""Errors of the estimator, one tree with one base."""


class EstimatorError(ValueError):
    """Base of every error the estimator raises on purpose; one sentence for the person who configured it."""


class NetworkError(EstimatorError):
    """An RC network that cannot be built, with what is wrong in the user's words."""


class OptionsError(EstimatorError):
    """An estimator option that does not exist or does not make sense. `options` are those that the sentence is about,
    the first of them the one to look at; empty where it is about the estimator itself."""

    def __init__(self, sentence: str, *options: str) -> None:
        super().__init__(sentence)
        self.options = options
