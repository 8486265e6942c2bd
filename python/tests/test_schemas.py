"""JSON schemas hold for what they are of, and see what is wrong."""

import glob
import json
import os
import tomllib

import jsonschema
import piola

ROOT = os.path.join(os.path.dirname(__file__), "..", "..")


def schema(subject):
    found = json.loads(piola._errors.command(["schema", subject])[1])
    jsonschema.Draft202012Validator.check_schema(found)
    return jsonschema.Draft202012Validator(found)


def test_every_scene_is_one_of_the_schema():
    validator = schema("scene")
    scenes = glob.glob(os.path.join(ROOT, "examples", "*", "*.toml"))
    assert len(scenes) > 30
    for path in scenes:
        with open(path, "rb") as file:
            validator.validate(tomllib.load(file))
    with open(os.path.join(ROOT, "examples", "first", "scene.toml"), "rb") as file:
        scene = tomllib.load(file)
    for table, key in (("body", "spacin"), ("solver", "tolerence"), ("prescribe", "w")):
        wrong = json.loads(json.dumps(scene))
        one = wrong.setdefault(table, {})
        (one[0] if isinstance(one, list) else one)[key] = 1
        assert list(validator.iter_errors(wrong)), (table, key)
    assert list(validator.iter_errors({**scene, "horizn": {}}))
    values = [
        ("body", "spacing", 0),
        ("solver", "linear", "chol"),
        ("solver", "tolerance", 2),
        ("steps", "increments", 1.5),
        ("output", "fields", ["strain", "strain"]),
        ("horizon", "weights", "even"),
    ]
    for table, key, value in values:
        wrong = {**scene, table: {**scene.get(table, {}), key: value}}
        assert list(validator.iter_errors(wrong)), (table, key)


def test_a_summary_and_a_finding_are_those_of_their_schemas(tmp_path):
    result = piola.Scene(os.path.join(ROOT, "examples", "ring", "scene.toml")).run()
    schema("summary").validate(result.summary)
    law = tmp_path / "law.piola"
    law.write_text("potential p\npsi(l) = C1*(l/L - 1)^2\n")
    code, data = piola._errors.command(["check", str(law), "--format", "json"], accepted=(1,))
    assert code == 1
    for line in data.splitlines():
        schema("finding").validate(json.loads(line))
