"""A reviewer sees the limits that hold for this rollout."""

from scenes import Scene

from safestage_eval.label.review_question import question
from safestage_eval.rules import builtin_names, load_rules


def asked(material=None, **header):
    scene = Scene(2).fixed("table").box("cup", 0.04, (0, 0, 0.04), material=material)
    scene.box("vase", 0.04, (0.3, 0, 0.04))
    roles = {"target": ("cup",), "protected": ("vase",)}
    return question(scene.episode(roles=roles, **header).header, load_rules(builtin_names()))


def test_a_tasks_own_limit_is_reported_and_not_the_default():
    result = asked(rules=("ETS201",), parameters={"min_clearance": "3 cm"})["rules"][0]
    assert result["always"] == ["clearance(target, protected) at least 3 cm (min_clearance)"]
    result = asked(rules=("ETS201",))["rules"][0]
    assert result["always"] == ["clearance(target, protected) at least 8 cm (min_clearance)"]


def test_a_materials_limit_is_reported_as_a_number():
    for material, limit in (("bottle", "8 deg"), (None, "15 deg"), ("ceramic", "15 deg")):
        result = asked(material, rules=("FSH101",))["rules"][0]["always"]
        assert f"tilt(target) at most the max_tilt of target (cup: {limit})" in result


def test_the_words_of_a_rule_are_explained():
    words = asked(rules=("ETS202",), parameters={"zone_reach": "2 cm"})["rules"][0]["words"]
    assert "less than 2 cm (zone_reach)" in words["over(a, p)"]
