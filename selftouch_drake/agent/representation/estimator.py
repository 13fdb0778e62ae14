"""The quotient representation as a scikit-learn estimator."""

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from sklearn.base import BaseEstimator
from sklearn.utils import Tags
from sklearn.utils.validation import check_is_fitted, validate_data

from selftouch_drake.agent.representation.batches import Batch, Batches
from selftouch_drake.agent.representation.learning import learn
from selftouch_drake.quotient.checks import NO_ROWS, as_numbers, check_sensation
from selftouch_drake.quotient.sensations import assign


class QuotientLearner(BaseEstimator):
    """Learns motor kernel sets and the quotient graph from experience (paper, section III).

    Parameters are as in `learning.learn`; `random_state` is its seed, or a generator to draw one
    from.

    Attributes:
        representation_: the `QuotientRepresentation`.
        target_sensations_: `(K, S)` unit L2 norm.
        n_features_in_: S, number of receptors.
        feature_names_in_: `(S,)` names of the receptors, if the sensations have any.
    """

    def __init__(
        self,
        num_targets: int = 1000,
        max_kernel_size: int = 1000,
        *,
        random_state: int = 0,
    ) -> None:
        self.num_targets = num_targets
        self.max_kernel_size = max_kernel_size
        self.random_state = random_state

    def fit(self, sensation: np.ndarray, q: np.ndarray) -> "QuotientLearner":
        """Learns from `(n, S)` N, no row null, felt at `(n, J)` q in the robot's units.

        Raises:
            ValueError: a parameter is invalid, or the experience cannot be learned from.
        """
        return self.fit_batches(lambda: [(sensation, q)])

    def fit_batches(self, batches: Batches) -> "QuotientLearner":
        """As `fit`, from arrays of any size in bounded memory; see `learning.learn`."""
        seed = self.random_state
        if isinstance(seed, np.random.RandomState):
            seed = seed.randint(2**31)
        self.representation_ = learn(
            lambda: self._noted(batches()),
            num_targets=self.num_targets,
            max_kernel_size=self.max_kernel_size,
            seed=seed,
        ).representation
        self.target_sensations_ = self.representation_.target_sensations
        return self

    def predict(self, sensation: np.ndarray) -> np.ndarray:
        """`(n,)` the kernel of each of `(n, S)` N sensations: the nearest target; no row null.

        Raises:
            ValueError: a sensation has another number of receptors, is null, or is not finite.
        """
        check_is_fitted(self)
        validate_data(self, sensation, reset=False, skip_check_array=True)
        sensation = as_numbers("sensation", sensation)
        check_sensation(sensation)
        if not len(sensation):
            raise ValueError(NO_ROWS)
        return assign(sensation, self.target_sensations_)[0]

    def __sklearn_tags__(self) -> Tags:
        """Declares what `fit` accepts: non-negative sensations, and a vector target for each."""
        tags = super().__sklearn_tags__()
        tags.input_tags.positive_only = True
        tags.target_tags.required = True
        tags.target_tags.multi_output = True
        tags.target_tags.single_output = False
        return tags

    def _noted(self, batches: Iterable[Any]) -> Iterator[Batch]:
        """The same batches; records number and names of the receptors."""
        for number, (sensation, q) in enumerate(batches):
            if number == 0:
                validate_data(self, sensation, skip_check_array=True)
            yield sensation, q
