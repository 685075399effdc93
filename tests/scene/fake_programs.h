// SPDX-License-Identifier: Apache-2.0
// Stand-ins for colmap and ffmpeg, which tests put on PATH.
#pragma once

namespace gs::test {

/// Writes what colmap would: the model of $COLMAP_MODEL and a smaller one, an undistorted scene, files nobody needs.
/// Its help is that of $COLMAP_STYLE: of 3.8 without CUDA, or of "4.1", which has it. Notes its calls in $COLMAP_CALLS.
inline constexpr const char* kFakeColmap = R"sh(#!/bin/sh
command=$1
case "$COLMAP_STYLE" in
  4.1) features=FeatureExtraction; matches=FeatureMatching; cuda="with CUDA"; prefix="I20260101 10:00:00.1 7 a.cc:1] ";;
  *) features=SiftExtraction; matches=SiftMatching; cuda="without CUDA"; COLMAP_STYLE=3.8; prefix="";;
esac
if [ "$command" = -h ]; then
  echo "COLMAP $COLMAP_STYLE -- Structure-from-Motion and Multi-View Stereo"
  echo "  (Commit Unknown on Unknown $cuda)"
  exit 0
fi
if [ "$2" = -h ]; then
  case $command in
    feature_extractor) echo "  --ImageReader.mask_path arg"; echo "  --$features.use_gpu arg (=1)";;
    *_matcher) echo "  --$matches.use_gpu arg (=1)"; echo "  --$matches.gpu_index arg (=-1)";;
  esac
  case $command in
    sequential_matcher)
      echo "  --SequentialMatching.overlap arg (=10)"
      echo "  --SequentialMatching.quadratic_overlap arg (=1)"
      echo "  --SequentialMatching.loop_detection arg (=0)"
      echo "  --SequentialMatching.loop_detection_period arg (=10)"
      echo "  --SequentialMatching.vocab_tree_path arg";;
    vocab_tree_matcher) echo "  --VocabTreeMatching.vocab_tree_path arg";;
  esac
  [ "$COLMAP_STYLE" = 3.8 ]; exit  # 1 from others, as some versions do
fi
echo "$QT_QPA_PLATFORM $*" >> "$COLMAP_CALLS"
while [ $# -gt 0 ]; do
  case $1 in --output_path) output=$2;; --input_path) input=$2;; --image_path) images=$2;; esac
  shift
done
if [ "$command" = "$COLMAP_FAILS_AT" ]; then
  for i in 1 2 3 4 5 6 7 8 9 10 11 12 13 14; do echo "all is well so far ($i)"; done
  echo "E1120 Something specific is broken" >&2
  exit 3
fi
case $command in
  feature_extractor)
    rm -rf "$COLMAP_CALLS.seen"
    cp -rL "$images" "$COLMAP_CALLS.seen"
    echo "${prefix}Processed file [1/2]"; echo "${prefix}Processed file [2/2]";;
  exhaustive_matcher) echo "${prefix}Matching block [2/3, 1/3] in 0.1s";;
  mapper)
    [ "$COLMAP_FINDS_NOTHING" = 1 ] && exit 0
    [ -n "$COLMAP_FINDS_NOTHING" ] && echo "ERROR: failed to create sparse model" && exit 1
    if [ "$COLMAP_STYLE" = 4.1 ]; then echo "${prefix}Registering image #7 (num_reg_frames=2)"
    else echo "Registering image #7 (2)"; fi
    mkdir -p "$output/0" "$output/1"
    printf '\001\000\000\000\000\000\000\000' > "$output/0/images.bin"
    cp "$COLMAP_MODEL"/* "$output/1/";;
  model_analyzer) echo "${prefix}Mean reprojection error: 0.479041px";;
  image_undistorter)
    mkdir -p "$output/images" "$output/sparse" "$output/stereo"
    cp "$input"/* "$output/sparse/"
    touch "$output/images/a.png" "$output/run-colmap-geometric.sh";;
esac
)sh";

/// Writes the images of $FFMPEG_FRAMES where the last argument says, or fails where $FFMPEG_FAILS is set. Notes its
/// arguments in $COLMAP_CALLS.ffmpeg.
inline constexpr const char* kFakeFfmpeg = R"sh(#!/bin/sh
echo "$*" >> "$COLMAP_CALLS.ffmpeg"
for last in "$@"; do :; done
if [ -n "$FFMPEG_FAILS" ]; then echo "moov atom not found" >&2; exit 1; fi
echo "  Duration: 00:00:01.00, start: 0.000000, bitrate: 1 kb/s"
echo "frame=5"
n=0
for frame in "$FFMPEG_FRAMES"/*; do cp "$frame" "$(printf "$last" $n)"; n=$((n+1)); done
)sh";

}  // namespace gs::test
