"""Functions that are pickled by their code."""

import pickle

from beamdae.function_pickler import pickle_with_functions


def make_law(offset):
    def law(t):
        return (lambda x: x + offset)(t)

    return law


def test_regression_pickled_functions_keep_their_files():
    """Since 3.1.3, cloudpickle replaces the file, so that workers lost the folder of a model."""
    law = make_law(0.5)
    copy = pickle.loads(pickle_with_functions(law))
    assert copy is not law
    assert copy(1.0) == law(1.0) == 1.5
    assert copy.__code__.co_filename == __file__
    assert copy.__code__ == law.__code__  # also the lambda inside
