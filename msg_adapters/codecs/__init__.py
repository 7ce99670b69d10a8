"""Encodings of events as words: one module each, compiled kernels over arrays."""

from msg_adapters.codecs.evt2 import Evt2Decoder
from msg_adapters.codecs.evt3 import Evt3Decoder
from msg_adapters.codecs.evt21 import Evt21Decoder
from msg_adapters.codecs.libcaer import LibcaerDecoder
from msg_adapters.codecs.libcaer_cmp import LibcaerCmpDecoder
from msg_adapters.codecs.mono import MonoDecoder, TriggerDecoder, encode_mono
from msg_adapters.codecs.words import DecodedWords, Triggers, WordDecoder

__all__ = [
    "DecodedWords",
    "Evt2Decoder",
    "Evt3Decoder",
    "Evt21Decoder",
    "LibcaerCmpDecoder",
    "LibcaerDecoder",
    "MonoDecoder",
    "TriggerDecoder",
    "Triggers",
    "WordDecoder",
    "encode_mono",
]
