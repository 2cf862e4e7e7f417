"""Model files: exact round trip, and refusal of everything that is not the file as written."""

import hashlib
import json

import numpy as np
import pytest

from calibrator import model_file
from calibrator.models import make_model
from stage_core.errors import StageError


@pytest.fixture
def stored():
    command = np.random.default_rng(0).uniform(0, 0.1, (60, 2))
    model = make_model('affine').fit(command, command * 1.0001 + 1e-5)
    return model_file.StoredModel(
        model, 'stage-7', 3, {'bags/a': 'ab' * 32}, {'after': {'rms': 1e-6}}, 42
    )


def test_round_trip_keeps_everything(stored, tmp_path):
    path = tmp_path / 'new' / 'model.json'
    model_file.save(stored, path)
    loaded = model_file.load(path, 'stage-7')
    points = np.array([[0.01, 0.02], [0.05, 0.09]])
    np.testing.assert_array_equal(loaded.invert(points), stored.invert(points))
    assert (loaded.machine, loaded.version, loaded.seed) == ('stage-7', 3, 42)
    assert loaded.training == stored.training
    assert loaded.metrics == stored.metrics


def test_saving_replaces_and_leaves_no_temporary_file(stored, tmp_path):
    path = tmp_path / 'model.json'
    path.write_text('old')
    model_file.save(stored, path)
    assert [p.name for p in tmp_path.iterdir()] == ['model.json']
    assert model_file.load(path).version == 3


def test_every_truncation_is_refused(stored, tmp_path):
    path = tmp_path / 'model.json'
    model_file.save(stored, path)
    text = path.read_text()
    for length in range(0, len(text), 97):
        path.write_text(text[:length])
        with pytest.raises(StageError):
            model_file.load(path)


def test_tampering_other_version_and_other_machine_are_refused(stored, tmp_path):
    path = tmp_path / 'model.json'
    model_file.save(stored, path)
    document = json.loads(path.read_text())

    altered = json.loads(json.dumps(document))
    altered['content']['model']['state']['offset']['array'][0] += 1e-6
    path.write_text(json.dumps(altered))
    with pytest.raises(StageError, match='altered'):
        model_file.load(path)

    path.write_text(json.dumps({**document, 'format_version': 99}))
    with pytest.raises(StageError, match='format version 99'):
        model_file.load(path)

    path.write_text(json.dumps(document))
    with pytest.raises(StageError, match='machine stage-7, this one is stage-8'):
        model_file.load(path, 'stage-8')

    for text, words in (('[1, 2]', 'holds no JSON object'), ('{}', 'is no calibration model')):
        path.write_text(text)
        with pytest.raises(StageError, match=words):
            model_file.load(path)
    with pytest.raises(StageError, match='cannot read'):
        model_file.load(tmp_path / 'absent.json')


def without_seed(content):
    del content['seed']


def without_gains(content):
    del content['model']['state']['gain']


def without_model(content):
    content['model'] = None


def of_one_axis(content):
    content['model']['axes'] = 1


def with_a_sensor_of_its_own(content):
    content['sensors'] = ['air']


@pytest.mark.parametrize(
    'change', [without_seed, without_gains, without_model, of_one_axis, with_a_sensor_of_its_own]
)
def test_a_whole_file_of_other_software_is_refused_in_one_line(stored, tmp_path, change):
    path = tmp_path / 'model.json'
    model_file.save(stored, path)
    document = json.loads(path.read_text())
    change(document['content'])
    body = json.dumps(document['content'], sort_keys=True, separators=(',', ':'))
    path.write_text(json.dumps({**document, 'sha256': hashlib.sha256(body.encode()).hexdigest()}))
    with pytest.raises(
        StageError, match='of other software or incomplete .*: train the model again'
    ):
        model_file.load(path)


@pytest.mark.parametrize('number', ['NaN', '1e999'])
def test_a_file_with_a_number_that_is_not_finite_is_refused(stored, tmp_path, number):
    path = tmp_path / 'model.json'
    model_file.save(stored, path)
    path.write_text(path.read_text().replace('"version": 3', f'"version": {number}'))
    with pytest.raises(StageError, match='altered after it was written'):
        model_file.load(path)


def test_a_number_that_is_not_finite_is_never_written(stored, tmp_path):
    path = tmp_path / 'model.json'
    stored.model.state['offset'][0] = np.inf
    with pytest.raises(StageError, match='not finite'):
        model_file.save(stored, path)
    assert not path.exists()


def test_bag_hash_sees_one_changed_byte(tmp_path):
    (tmp_path / 'a.mcap').write_bytes(b'abc')
    first = model_file.bag_hash(tmp_path)
    (tmp_path / 'a.mcap').write_bytes(b'abd')
    assert model_file.bag_hash(tmp_path) != first
