"""The sidecar: what is found again, what is not, and what is never touched."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest

from openprc.errors import NoFeaturesError
from openprc.vision import ArraySource, FeatureMapCache, VideoSource, register_detector
from openprc.vision.detection import cache, cache_file, registry
from openprc.vision.detection.feature_map import PER_FEATURE
from openprc.vision.opencv import load_cv2
from openprc.vision.synth import cases


@pytest.fixture(scope="module")
def frames():
    return list(cases.case("translation", n_frames=3, shape=(120, 160)).frames())


@pytest.fixture
def clip(tmp_path, frames):
    cv2 = load_cv2()
    folder = tmp_path / "video"
    folder.mkdir()
    path = folder / "clip.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"FFV1"), 30.0, (160, 120), False)
    for frame in frames:
        writer.write(frame)
    writer.release()
    return path


@pytest.fixture
def sidecar(clip):
    return clip.with_name("clip.avi.fmap.h5")


@pytest.fixture
def home(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home"))
    return tmp_path / "home" / "openprc" / "features"


@pytest.fixture
def detections(monkeypatch):
    """Count how often something is detected."""
    calls = []

    def counted(*arguments, **settings):
        calls.append(settings)
        return registry.detect(*arguments, **settings)

    monkeypatch.setattr(cache, "detect", counted)
    return calls


def same(first, second):
    for part in PER_FEATURE:
        one, other = getattr(first, part), getattr(second, part)
        assert (one is None) == (other is None)
        if one is not None:
            np.testing.assert_array_equal(one, other)
            assert one.dtype == other.dtype
    for name in ("detector_name", "detector_config", "ref_frame_index", "frame_shape", "notes"):
        assert getattr(first, name) == getattr(second, name)


@pytest.mark.parametrize("method", ["sift", "orb", "akaze", "gftt"])
def test_what_was_detected_is_found_again(clip, sidecar, detections, method):
    source = VideoSource(clip)
    made = FeatureMapCache(source).get_or_detect(source.read_frame(0), method=method)
    assert sidecar.exists()
    assert len(detections) == 1
    again = VideoSource(clip)
    found = FeatureMapCache(again).get_or_detect(again.read_frame(0), method=method)
    assert len(detections) == 1
    same(made, found)
    assert sorted(p.name for p in clip.parent.iterdir()) == [clip.name, sidecar.name]


def test_the_calls_of_the_paper(clip, detections):
    src = VideoSource(clip)
    fmap = FeatureMapCache(src).get_or_detect(
        src.read_frame(0), method="sift", contrast_threshold=0.04
    )
    best = fmap.top_n(200)
    assert 0 < len(best) <= 200
    # The threshold given is the default, so both are one and the same detection.
    FeatureMapCache(src).get_or_detect(src.read_frame(0))
    assert len(detections) == 1


def test_a_recording_that_moved_is_the_same_recording(clip, sidecar, detections, tmp_path):
    source = VideoSource(clip)
    FeatureMapCache(source).get_or_detect(source.read_frame(0))
    moved = tmp_path / "other"
    clip.parent.rename(moved)
    source = VideoSource(moved / clip.name)
    FeatureMapCache(source).get_or_detect(source.read_frame(0))
    assert len(detections) == 1


@pytest.mark.parametrize("change", [
    "frame", "index", "pixels", "mask", "method", "settings", "opencv", "openprc", "recording",
])  # fmt: skip
def test_anything_that_differs_is_detected_anew(clip, detections, frames, monkeypatch, change):
    source = VideoSource(clip)
    image, settings = source.read_frame(0), {"method": "gftt"}
    FeatureMapCache(source).get_or_detect(image, **settings)
    if change == "frame":
        image = source.read_frame(1)
    elif change == "index":
        settings["ref_frame_index"] = 1
    elif change == "pixels":
        image = image.copy()
        image[60, 80] ^= 64
    elif change == "mask":
        settings["mask"] = np.arange(120 * 160).reshape(120, 160) % 160 > 20
    elif change == "method":
        settings["method"] = "sift"
    elif change == "settings":
        settings["quality_level"] = 0.02
    elif change == "opencv":
        monkeypatch.setattr(load_cv2(), "__version__", "9.9.9")
    elif change == "openprc":
        monkeypatch.setattr(cache, "__version__", "9.9.9")
    else:
        # The first frame stays as it was, and the file is another one.
        with clip.open("ab") as stream:
            stream.write(b"more")
        source = VideoSource(clip)
    made = FeatureMapCache(source).get_or_detect(image, **settings)
    assert len(detections) == 2
    same(FeatureMapCache(source).get_or_detect(image, **settings), made)
    assert len(detections) == 2


def test_many_detections_share_a_file_and_the_oldest_make_room(
    clip, sidecar, detections, monkeypatch
):
    monkeypatch.setattr(cache_file, "MOST", 3)
    source = VideoSource(clip)
    for corners in (10, 20, 30, 40):
        kept = FeatureMapCache(source)
        kept.get_or_detect(source.read_frame(0), "gftt", max_corners=corners)
    with h5py.File(sidecar) as file:
        assert len(file) == 3
    for corners in (40, 30, 20):
        found = FeatureMapCache(source).get_or_detect(
            source.read_frame(0), "gftt", max_corners=corners
        )
        assert len(found) == corners
        assert len(detections) == 4
    FeatureMapCache(source).get_or_detect(source.read_frame(0), "gftt", max_corners=10)
    assert len(detections) == 5


def test_nothing_found_is_not_kept(clip, sidecar):
    source = VideoSource(clip)
    with pytest.raises(NoFeaturesError, match="black"):
        FeatureMapCache(source).get_or_detect(np.zeros((120, 160), np.uint8))
    assert not sidecar.exists()


@pytest.mark.parametrize("damage", ["cut", "flipped", "column", "empty"])
def test_a_damaged_sidecar_is_noted_and_replaced(clip, sidecar, detections, damage):
    source = VideoSource(clip)
    made = FeatureMapCache(source).get_or_detect(source.read_frame(0), "gftt")
    content = bytearray(sidecar.read_bytes())
    if damage == "cut":
        sidecar.write_bytes(content[: len(content) // 2])
    elif damage == "flipped":
        with h5py.File(sidecar) as file:
            (name,) = file
            at = file[name]["keypoints"].id.get_chunk_info(0).byte_offset
        content[at + 20 : at + 40] = bytes(20)
        sidecar.write_bytes(content)
    elif damage == "column":
        with h5py.File(sidecar, "r+") as file:
            (name,) = file
            del file[name]["sizes"]
    else:
        sidecar.write_bytes(b"")
    kept = FeatureMapCache(source)
    found = kept.get_or_detect(source.read_frame(0), "gftt")
    assert len(detections) == 2
    (note,) = kept.notes
    assert "clip.avi.fmap.h5 is damaged and its features are detected anew" in note
    assert found.notes == (note,)
    np.testing.assert_array_equal(found.keypoints, made.keypoints)
    clean = FeatureMapCache(source)
    clean.get_or_detect(source.read_frame(0), "gftt")
    assert len(detections) == 2
    assert clean.notes == []


def test_of_a_file_with_one_damaged_map_the_others_are_kept(clip, sidecar, detections):
    source = VideoSource(clip)
    image = source.read_frame(0)
    for corners in (10, 20):
        FeatureMapCache(source).get_or_detect(image, "gftt", max_corners=corners)
    with h5py.File(sidecar, "r+") as file:
        (name,) = (name for name in file if len(file[name]["sizes"]) == 10)
        del file[name]["sizes"]
    FeatureMapCache(source).get_or_detect(image, "gftt", max_corners=30)
    with h5py.File(sidecar) as file:
        assert sorted(len(group["sizes"]) for group in file.values()) == [20, 30]
    kept = FeatureMapCache(source)
    kept.get_or_detect(image, "gftt", max_corners=20)
    assert (len(detections), kept.notes) == (3, [])


def foreign_hdf5(path):
    with h5py.File(path, "w") as file:
        file.attrs["content_hash"] = "abc"
        file.create_group("sift")["keypoints"] = np.zeros((3, 2))


@pytest.mark.parametrize(
    "make",
    [foreign_hdf5, lambda path: path.write_text("my notes"), lambda path: path.mkdir()],
    ids=["hdf5", "text", "folder"],
)
def test_a_file_that_is_not_ours_stays(clip, sidecar, home, detections, make):
    make(sidecar)
    before = sidecar.read_bytes() if sidecar.is_file() else b""
    source = VideoSource(clip)
    kept = FeatureMapCache(source)
    kept.get_or_detect(source.read_frame(0), "gftt")
    assert "was not made by this cache and stays as it is; they are kept" in kept.notes[-1]
    assert (sidecar.read_bytes() if sidecar.is_file() else b"") == before
    assert len(list(home.iterdir())) == 1
    FeatureMapCache(source).get_or_detect(source.read_frame(0), "gftt")
    assert len(detections) == 1


def test_a_read_only_folder_stays_as_it_is(clip, sidecar, home, detections):
    clip.parent.chmod(0o555)
    source = VideoSource(clip)
    try:
        kept = FeatureMapCache(source)
        found = kept.get_or_detect(source.read_frame(0), "gftt")
    finally:
        clip.parent.chmod(0o755)
    assert kept.notes == [
        "features cannot be kept in video: it is read-only; "
        "they are kept in the user's cache folder"
    ]
    assert found.notes == tuple(kept.notes)
    assert not sidecar.exists()
    assert len(list(home.iterdir())) == 1
    FeatureMapCache(source).get_or_detect(source.read_frame(0), "gftt")
    assert len(detections) == 1


def test_a_folder_for_the_cache_can_be_named(clip, sidecar, detections, tmp_path):
    source = VideoSource(clip)
    place = tmp_path / "new" / "cache"
    FeatureMapCache(source, cache_dir=place).get_or_detect(source.read_frame(0), "gftt")
    assert [p.name for p in place.iterdir()] == ["clip.avi.fmap.h5"]
    assert not sidecar.exists()
    FeatureMapCache(source, cache_dir=place).get_or_detect(source.read_frame(0), "gftt")
    assert len(detections) == 1


def test_where_nothing_can_be_kept_there_is_a_note(clip, tmp_path):
    (tmp_path / "file").write_text("no folder")
    source = VideoSource(clip)
    kept = FeatureMapCache(source, cache_dir=tmp_path / "file")
    assert len(kept.get_or_detect(source.read_frame(0), "gftt")) > 10
    assert kept.notes[0].startswith("features cannot be kept in file: ")
    assert kept.notes[0].endswith("; nothing is kept")


@pytest.mark.parametrize("given", ["folder", "pattern", "."])
def test_maps_of_images_lie_beside_their_folder(tmp_path, frames, monkeypatch, detections, given):
    folder = tmp_path / "images"
    folder.mkdir()
    for k, frame in enumerate(frames):
        load_cv2().imwrite(str(folder / f"img_{k:04d}.png"), frame)
    monkeypatch.chdir(folder)
    path = {"folder": folder, "pattern": folder / "img_%04d.png", ".": Path()}[given]
    for _ in range(2):
        source = VideoSource(path, fps=30.0)
        FeatureMapCache(source).get_or_detect(source.read_frame(0), "gftt")
    assert len(detections) == 1
    found = [p.relative_to(tmp_path).as_posix() for p in tmp_path.rglob("*.fmap.h5")]
    assert found == {"pattern": ["images/img__04d.png.fmap.h5"]}.get(given, ["images.fmap.h5"])
    assert VideoSource(folder, fps=30.0).frame_count == 3


def test_images_in_memory_are_remembered_by_the_object(frames, detections, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    source = ArraySource(np.stack(frames), fps=30.0)
    kept = FeatureMapCache(source)
    first = kept.get_or_detect(source.read_frame(0), "gftt")
    same(first, kept.get_or_detect(source.read_frame(0), "gftt"))
    assert len(detections) == 1
    assert not list(tmp_path.iterdir())


def test_deep_frames_are_scaled_as_the_source_does(frames):
    deep = np.stack(frames).astype(np.uint16) * 8
    source = ArraySource(deep, fps=30.0, value_range=(0, 2040))
    kept = FeatureMapCache(source)
    found = kept.get_or_detect(source.read_frame(0), "gftt")
    np.testing.assert_array_equal(found.keypoints, registry.detect(frames[0], "gftt").keypoints)
    # What is grey already is not scaled again.
    grey = kept.get_or_detect(next(source.frames()).grey, "gftt")
    np.testing.assert_array_equal(grey.keypoints, found.keypoints)


def test_a_detector_registered_by_a_script_is_asked_every_time(clip, sidecar, monkeypatch):
    monkeypatch.setattr(registry, "_OWN", {})
    source = VideoSource(clip)

    class Fixed:
        def __init__(self, x=20.0):
            self.x = x

        def detect(self, image):
            return [(self.x, 20.0)]

    register_detector("fixed", Fixed)
    kept = FeatureMapCache(source)
    assert kept.get_or_detect(source.read_frame(0), "fixed").keypoints[0, 0] == 20
    register_detector("fixed", lambda: Fixed(30.0), overwrite=True)
    assert kept.get_or_detect(source.read_frame(0), "fixed").keypoints[0, 0] == 30
    assert not sidecar.exists()


class Plain:
    """A plugin's detector without words for itself."""

    def __init__(self, size=3, places=None):
        self.size, self.places = size, places

    def detect(self, image):
        return [(20.0 + self.size, 20.0)]


def test_a_detector_of_a_plugin_is_kept_by_its_plain_settings(clip, detections, monkeypatch):
    item = SimpleNamespace(
        name="plain", qualified_name="openprc-x/plain", version="1",
        spec=SimpleNamespace(load=f"{__name__}:Plain"),
    )  # fmt: skip
    hook = SimpleNamespace(records=lambda _hook: [item], find=lambda _hook, _name: item)
    monkeypatch.setattr(registry, "default_registry", lambda: hook)
    source = VideoSource(clip)
    for settings in ({}, {}, {"size": 4}, {"size": 4}):
        FeatureMapCache(source).get_or_detect(source.read_frame(0), "plain", **settings)
    assert len(detections) == 2
    for _ in range(2):
        FeatureMapCache(source).get_or_detect(source.read_frame(0), "plain", places=np.zeros(5000))
    assert len(detections) == 4
    item.version = "2"
    FeatureMapCache(source).get_or_detect(source.read_frame(0), "plain")
    assert len(detections) == 5


def test_what_is_wrong_with_the_environment_is_told_only_while_it_is(clip, monkeypatch):
    source = VideoSource(clip)
    for module in (cache, registry):
        monkeypatch.setattr(module, "conflict_note", lambda: "two wheels")
    for _ in range(2):
        found = FeatureMapCache(source).get_or_detect(source.read_frame(0), "gftt")
        assert found.notes == ("two wheels",)
    for module in (cache, registry):
        monkeypatch.setattr(module, "conflict_note", lambda: None)
    assert FeatureMapCache(source).get_or_detect(source.read_frame(0), "gftt").notes == ()
