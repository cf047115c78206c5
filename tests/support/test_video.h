// SPDX-License-Identifier: BSD-3-Clause
#pragma once

extern "C" {
#include <libavcodec/avcodec.h>
#include <libavformat/avformat.h>
#include <libavutil/display.h>
#include <libavutil/log.h>
}

#include <cstring>
#include <memory>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "mgsfm/base/error.h"

namespace mgsfm {

struct TestVideo {
  std::vector<cv::Mat> images;    // gray, with even sides
  std::vector<int64_t> times_ms;  // one per image, ascending
  // "ffv1" is lossless, "mjpeg" and "mpeg4" are not.
  std::string codec = "ffv1";
  int num_b_frames = 0;       // mpeg4: images that are stored out of order
  int rotation_deg = 0;       // clockwise turn that makes the images upright
  std::string creation_time;  // "2023-05-01T12:34:56Z"
};

namespace test_video {

constexpr int64_t kDurationMs = 20;  // of one image

inline void Check(int code) {
  MGSFM_CHECK_MSG(code >= 0, std::to_string(code));
}

inline AVPixelFormat FormatOf(const std::string& codec) {
  if (codec == "ffv1") return AV_PIX_FMT_GRAY8;
  return codec == "mjpeg" ? AV_PIX_FMT_YUVJ420P : AV_PIX_FMT_YUV420P;
}

// Luminance is the image, both chrominances are neutral.
inline void Fill(const cv::Mat& image, AVFrame* frame) {
  Check(av_frame_make_writable(frame));
  for (int y = 0; y < image.rows; ++y) {
    std::memcpy(frame->data[0] + y * frame->linesize[0], image.ptr(y),
                static_cast<size_t>(image.cols));
  }
  for (int plane = 1; plane < 3 && frame->data[plane] != nullptr; ++plane) {
    std::memset(frame->data[plane], 128,
                static_cast<size_t>(frame->linesize[plane] * image.rows / 2));
  }
}

inline void WritePackets(AVCodecContext* codec, AVStream* stream,
                         AVFormatContext* format) {
  AVPacket* packet = av_packet_alloc();
  while (avcodec_receive_packet(codec, packet) >= 0) {
    packet->stream_index = stream->index;
    packet->duration = kDurationMs;
    av_packet_rescale_ts(packet, codec->time_base, stream->time_base);
    Check(av_interleaved_write_frame(format, packet));
  }
  av_packet_free(&packet);
}

inline AVCodecContext* OpenCodec(const TestVideo& video,
                                 const AVFormatContext& format) {
  const AVCodec* encoder = avcodec_find_encoder_by_name(video.codec.c_str());
  AVCodecContext* codec = avcodec_alloc_context3(encoder);
  codec->width = video.images.front().cols;
  codec->height = video.images.front().rows;
  codec->pix_fmt = FormatOf(video.codec);
  codec->color_range =
      video.codec == "mpeg4" ? AVCOL_RANGE_MPEG : AVCOL_RANGE_JPEG;
  codec->time_base = {1, 1000};
  codec->max_b_frames = video.num_b_frames;
  codec->flags |= AV_CODEC_FLAG_QSCALE;
  codec->global_quality = 2 * FF_QP2LAMBDA;
  if ((format.oformat->flags & AVFMT_GLOBALHEADER) != 0) {
    codec->flags |= AV_CODEC_FLAG_GLOBAL_HEADER;
  }
  Check(avcodec_open2(codec, encoder, nullptr));
  return codec;
}

inline AVStream* AddStream(const TestVideo& video, const AVCodecContext& codec,
                           AVFormatContext* format) {
  AVStream* stream = avformat_new_stream(format, nullptr);
  stream->time_base = codec.time_base;
  Check(avcodec_parameters_from_context(stream->codecpar, &codec));
  if (video.rotation_deg != 0) {
    uint8_t* matrix = av_stream_new_side_data(stream, AV_PKT_DATA_DISPLAYMATRIX,
                                              9 * sizeof(int32_t));
    av_display_rotation_set(reinterpret_cast<int32_t*>(matrix),
                            video.rotation_deg);
  }
  if (!video.creation_time.empty()) {
    av_dict_set(&format->metadata, "creation_time", video.creation_time.c_str(),
                0);
  }
  return stream;
}

}  // namespace test_video

// Writes a video in the format of the extension.
inline void WriteTestVideo(const std::string& path, const TestVideo& video) {
  using namespace test_video;  // NOLINT(google-build-using-namespace)
  MGSFM_CHECK_EQ(video.images.size(), video.times_ms.size());
  av_log_set_level(AV_LOG_ERROR);
  AVFormatContext* format = nullptr;
  Check(
      avformat_alloc_output_context2(&format, nullptr, nullptr, path.c_str()));
  AVCodecContext* codec = OpenCodec(video, *format);
  AVStream* stream = AddStream(video, *codec, format);
  Check(avio_open(&format->pb, path.c_str(), AVIO_FLAG_WRITE));
  AVDictionary* options = nullptr;
  // The index first, so that truncated files open; ignored by others.
  av_dict_set(&options, "movflags", "faststart", 0);
  Check(avformat_write_header(format, &options));
  av_dict_free(&options);
  AVFrame* frame = av_frame_alloc();
  frame->width = codec->width;
  frame->height = codec->height;
  frame->format = codec->pix_fmt;
  frame->color_range = codec->color_range;
  frame->quality = codec->global_quality;
  Check(av_frame_get_buffer(frame, 0));
  for (size_t i = 0; i < video.images.size(); ++i) {
    Fill(video.images[i], frame);
    frame->pts = video.times_ms[i];
    Check(avcodec_send_frame(codec, frame));
    WritePackets(codec, stream, format);
  }
  Check(avcodec_send_frame(codec, nullptr));
  WritePackets(codec, stream, format);
  Check(av_write_trailer(format));
  av_frame_free(&frame);
  avcodec_free_context(&codec);
  avio_closep(&format->pb);
  avformat_free_context(format);
}

}  // namespace mgsfm
