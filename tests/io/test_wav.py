"""WAV files of every kind come back as they were written; odd and truncated ones are named."""

from __future__ import annotations

import contextlib
import struct
import warnings
import wave

import numpy as np
import pytest
from scipy.io import wavfile

from myomorph.core.io import wav
from myomorph.core.io.wav import read_wav
from myomorph.core.model.errors import BadData, BadFile, UnknownName
from myomorph.core.model.series import Sound

SOUND = np.random.default_rng(0).uniform(-0.95, 0.95, (1001, 3))


def written(path, kind):
    if np.issubdtype(kind, np.floating):
        values = SOUND.astype(kind)
    elif kind == np.uint8:
        values = np.round(SOUND * 128 + 128).astype(kind)
    else:
        values = np.round(SOUND * (np.iinfo(kind).max + 1.0)).astype(kind)
    wavfile.write(path, 44100, values)
    return path


STEPS = {
    np.uint8: 2**-8,
    np.int16: 2**-16,
    np.int32: 2**-24,
    np.float32: 2**-24,
    np.float64: 2**-24,
}


@pytest.mark.parametrize(("kind", "step"), STEPS.items())
def test_what_scipy_writes_is_read_back(tmp_path, kind, step):
    found = read_wav(written(tmp_path / "a.wav", kind), start=1.5)
    np.testing.assert_allclose(found.samples, SOUND, atol=1.01 * step)
    assert (found.rate, found.names, found.warnings) == (44100.0, ("1", "2", "3"), ())
    assert found.time[0] == 1.5
    assert found.duration == pytest.approx(1001 / 44100)


def test_24_bits_as_the_standard_library_writes_them(tmp_path):
    path = tmp_path / "a.wav"
    whole = np.round(SOUND[:, :1] * 2**23).astype("<i4")
    with wave.open(str(path), "wb") as stream:
        stream.setnchannels(1)
        stream.setsampwidth(3)
        stream.setframerate(96000)
        stream.writeframes(whole.view(np.uint8).reshape(-1, 4)[:, :3].tobytes())
    found = read_wav(path)
    np.testing.assert_array_equal(found.samples, (whole / 2.0**23).astype(np.float32))


def chunk(name: bytes, body: bytes) -> bytes:
    return name + struct.pack("<I", len(body)) + body + b"\0" * (len(body) % 2)


def riff(*chunks: bytes) -> bytes:
    body = b"WAVE" + b"".join(chunks)
    return b"RIFF" + struct.pack("<I", len(body)) + body


def form(kind=1, channels=2, rate=48000, bits=16, more=b"") -> bytes:
    block = channels * bits // 8
    return chunk(
        b"fmt ",
        struct.pack("<HHIIHH", kind, channels, rate, rate * block, block, bits & 0xFFFF) + more,
    )


def test_other_chunks_and_the_extensible_form_are_stepped_over(tmp_path):
    values = np.arange(-10, 10, dtype="<i2")
    more = struct.pack("<HHIH", 22, 16, 3, 1) + b"\0" * 14
    data = riff(
        chunk(b"bext", b"odd"),
        form(0xFFFE, more=more),
        chunk(b"LIST", b"12345"),
        chunk(b"data", values.tobytes()),
    )
    (tmp_path / "a.wav").write_bytes(data)
    np.testing.assert_array_equal(
        read_wav(tmp_path / "a.wav").samples.ravel(), values / np.float32(32768)
    )


def test_a_recording_that_was_cut_off_is_read_as_far_as_it_goes(tmp_path):
    path = written(tmp_path / "a.wav", np.int16)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2 + 1])
    found = read_wav(path)
    assert 490 <= len(found) < 502
    assert "ends after 0.011 of 0.023 s" in found.warnings[0]
    place = whole.index(b"data") + 4
    path.write_bytes(whole[:place] + struct.pack("<I", 0) + whole[place + 4 :])
    assert len(read_wav(path)) == 1001
    assert "never wrote how long" in read_wav(path).warnings[0]


@pytest.mark.parametrize(
    ("data", "told"),
    [
        (b"", "is empty"),
        (b"ID3 this is an mp3" * 10, "is no WAV file"),
        (b"RF64" + b"\0" * 100, "is a RF64 file, which is not read"),
        (riff(form(), chunk(b"data", b"")), "holds no samples"),
        (riff(form()), "chunk 'data' is missing"),
        (riff(chunk(b"data", b"1234"), form()), "before the chunk 'fmt '"),
        (riff(chunk(b"fmt ", b"12"), chunk(b"data", b"1234")), "has 2 bytes instead of 16 or more"),
        (riff(form(2, bits=4), chunk(b"data", b"1234")), "holds samples as ADPCM of 4 bits"),
        (riff(form(1, bits=12), chunk(b"data", b"1234")), "holds samples as integers of 12 bits"),
        (riff(form(channels=0), chunk(b"data", b"1234")), "says 0 channels at 48000 Hz"),
        (riff(form(rate=0), chunk(b"data", b"1234")), "says 2 channels at 0 Hz"),
    ],
)
def test_what_cannot_be_read_is_named(tmp_path, data, told):
    path = tmp_path / "a.wav"
    path.write_bytes(data)
    with pytest.raises(BadFile, match=told):
        read_wav(path)


def test_a_missing_file_and_too_much_sound_are_named(tmp_path, monkeypatch):
    with pytest.raises(BadFile, match="no such file"):
        read_wav(tmp_path / "none.wav")
    monkeypatch.setattr(wav, "LARGEST", 4 * 3 * 1000)
    with pytest.raises(BadFile, match="holds 1001 samples of 3 channels, too many"):
        read_wav(written(tmp_path / "a.wav", np.int16))


def test_files_broken_anywhere_are_read_or_refused_but_never_break(tmp_path):
    whole = written(tmp_path / "a.wav", np.int16).read_bytes()[:400]
    rng = np.random.default_rng(1)
    path = tmp_path / "b.wav"
    for _ in range(150):
        broken = bytearray(whole[: rng.integers(1, len(whole))])
        for place in rng.integers(0, len(broken), 3):
            broken[place] = rng.integers(256)
        path.write_bytes(bytes(broken))
        with warnings.catch_warnings(), contextlib.suppress(BadFile):
            warnings.simplefilter("error")
            assert len(read_wav(path))


def test_the_noun_checks_its_shape():
    with pytest.raises(BadData, match="expected samples of shape"):
        Sound(48000.0, ("a",), np.zeros((10, 2)))
    with pytest.raises(BadData, match="0 samples per second"):
        Sound(0.0, ("a",), np.zeros((10, 1)))
    with pytest.raises(UnknownName, match="the recording has 'a'"):
        Sound(48000.0, ("a",), np.zeros((10, 1)))["b"]
