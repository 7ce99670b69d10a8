"""Described parameters."""

from dataclasses import dataclass

import pytest

from etd_ros.parameters import ParameterError, Parameters, described, from_mapping, parameter


@dataclass(frozen=True)
class Example(Parameters):
    count: int = parameter(3, "a count", low=1, high=9)
    share: float = parameter(0.5, "a share", low=0.0, high=1.0)
    pair: tuple[float, float] = parameter((0.1, 0.2), "two numbers", low=0.0)
    kind: str = parameter("plain", "a kind", choices=("plain", "fancy"))
    on: bool = parameter(True, "a switch")
    words: tuple[str, ...] = parameter(("one", "two"), "any number of words")


def test_values_are_taken_by_name_and_the_rest_keeps_its_default():
    assert from_mapping(Example, {"count": 4, "pair": [1, 2]}) == Example(count=4, pair=(1.0, 2.0))


def test_a_whole_number_serves_as_a_float():
    assert from_mapping(Example, {"share": 1}).share == 1.0


@pytest.mark.parametrize("words", [[], ["three"], ("three", "four", "five")])
def test_a_list_of_texts_may_have_any_length(words):
    assert from_mapping(Example, {"words": words}).words == tuple(words)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (
            {"counts": 4},
            r"unknown parameter 'counts' \(is count meant\?\): known are count, kind, on, pair, ",
        ),
        ({"count": 10}, r"count = 10 is out of range \[1, 9\]"),
        ({"count": 2.5}, "count needs a whole number, not"),
        ({"count": True}, "count needs a whole number, not"),
        ({"share": float("nan")}, "not a finite number"),
        ({"pair": [1.0]}, "list of 2 numbers"),
        ({"pair": "12"}, "list of 2 numbers"),
        ({"pair": [1.0, -1.0]}, "out of range"),
        ({"kind": "odd"}, "choose one of plain, fancy"),
        ({"on": 1}, "on needs true or false, not 1"),
        ({"words": "one"}, "words needs a list of texts"),
        ({"words": ["one", 2]}, "words needs a text, not 2"),
    ],
)
def test_wrong_values_are_named_with_what_is_allowed(values, words):
    with pytest.raises(ParameterError, match=words):
        from_mapping(Example, values)


def test_every_parameter_is_described():
    assert [name for name, _, _ in described(Example)] == ["count", "share", "pair", "kind", "on", "words"]
    assert next(text.text for _, _, text in described(Example)) == "a count"
