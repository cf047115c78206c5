// SPDX-License-Identifier: BSD-3-Clause
#include "video/video_decoder.h"

extern "C" {
#include <libavcodec/avcodec.h>
#include <libavformat/avformat.h>
#include <libavutil/display.h>
#include <libavutil/log.h>
#include <libavutil/mathematics.h>
#include <libavutil/parseutils.h>
#include <libavutil/pixdesc.h>
#include <libswscale/swscale.h>
}

#include <algorithm>
#include <cmath>
#include <limits>
#include <new>
#include <string>
#include <tuple>

#include "base/ranges.h"
#include "files/image_reading.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

// Containers with embedded data. Playlists could refer to other files.
constexpr char kContainers[] =
    "mov,mp4,matroska,webm,avi,mpegts,mpeg,asf,flv,ogg,mxf,nut";
constexpr AVRational kNanosecondTimeBase = {1, 1'000'000'000};

struct Deleter {
  void operator()(AVFormatContext* context) const {
    avformat_close_input(&context);
  }
  void operator()(AVCodecContext* context) const {
    avcodec_free_context(&context);
  }
  void operator()(AVPacket* packet) const { av_packet_free(&packet); }
  void operator()(AVFrame* frame) const { av_frame_free(&frame); }
  void operator()(SwsContext* scaler) const { sws_freeContext(scaler); }
};

template <class T>
using Owned = std::unique_ptr<T, Deleter>;

template <class T>
Owned<T> CheckedOwner(T* object) {
  if (object == nullptr) throw std::bad_alloc();
  return Owned<T>(object);
}

std::string ReasonOf(int code) {
  char text[AV_ERROR_MAX_STRING_SIZE] = {};
  av_strerror(code, text, sizeof(text));
  return text;
}

[[noreturn]] void Throw(const fs::path& path, const std::string& problem) {
  throw Error("video '" + path.string() + "' " + problem);
}

// A file and its best video stream.
class VideoFile {
 public:
  explicit VideoFile(const fs::path& path) : path_(path) {
    av_log_set_level(AV_LOG_QUIET);  // errors become exceptions
    std::error_code ignored;
    if (!fs::is_regular_file(path, ignored)) {
      Throw(path, "does not exist or is not a file; check the path");
    }
    Open();
    if (avformat_find_stream_info(format_.get(), nullptr) < 0) ThrowDamaged("");
    const int number = av_find_best_stream(format_.get(), AVMEDIA_TYPE_VIDEO,
                                           -1, -1, &codec_, 0);
    if (number == AVERROR_DECODER_NOT_FOUND) {
      Throw(path,
            "is in a format that libavcodec cannot decode; convert it to "
            "H.264, for instance");
    }
    if (number < 0) Throw(path, "contains no images; choose another file");
    stream_ = format_->streams[number];
  }

  // Returns false at the end.
  bool ReadPacket(AVPacket* packet) {
    while (true) {
      av_packet_unref(packet);
      const int code = av_read_frame(format_.get(), packet);
      // Packets after an unreadable one cannot be found.
      is_cut_off_ |= code < 0 && code != AVERROR_EOF;
      if (code < 0) return false;
      if (packet->stream_index == stream_->index) return true;
    }
  }

  int64_t ToNs(int64_t time) const {
    return av_rescale_q(time, stream_->time_base, kNanosecondTimeBase);
  }

  [[noreturn]] void ThrowDamaged(const std::string& reason) const {
    Throw(path_, "is damaged or not a video" +
                     (reason.empty() ? "" : " (" + reason + ")") +
                     "; copy it again from the camera or repair it");
  }

  bool is_cut_off() const { return is_cut_off_; }
  const fs::path& path() const { return path_; }
  const AVFormatContext& format() const { return *format_; }
  const AVStream& stream() const { return *stream_; }
  const AVCodec& codec() const { return *codec_; }

 private:
  void Open() {
    AVDictionary* options = nullptr;
    av_dict_set(&options, "protocol_whitelist", "file", 0);
    av_dict_set(&options, "format_whitelist", kContainers, 0);
    AVFormatContext* format = nullptr;
    const int code = avformat_open_input(
        &format, ("file:" + path_.string()).c_str(), nullptr, &options);
    av_dict_free(&options);
    if (code < 0) ThrowDamaged(ReasonOf(code));
    format_.reset(format);
  }

  const fs::path path_;
  Owned<AVFormatContext> format_;
  const AVCodec* codec_ = nullptr;
  AVStream* stream_ = nullptr;
  bool is_cut_off_ = false;
};

std::optional<int64_t> CreationTimeNs(const AVFormatContext& format) {
  const AVDictionaryEntry* const tag =
      av_dict_get(format.metadata, "creation_time", nullptr, 0);
  int64_t time_us = 0;
  if (tag == nullptr || av_parse_time(&time_us, tag->value, 0) < 0) {
    return std::nullopt;
  }
  // Cameras without a clock write the first date of their calendar.
  constexpr int64_t kYear2000Us = 946'684'800'000'000;
  if (time_us < kYear2000Us) return std::nullopt;
  return 1000 * time_us;
}

// The clockwise rotation that makes images upright; nullopt if there is none.
std::optional<cv::RotateFlags> TurnOf(const AVStream& stream) {
  const uint8_t* const matrix =
      av_stream_get_side_data(&stream, AV_PKT_DATA_DISPLAYMATRIX, nullptr);
  if (matrix == nullptr) return std::nullopt;
  const double angle_deg =
      -av_display_rotation_get(reinterpret_cast<const int32_t*>(matrix));
  if (!std::isfinite(angle_deg)) return std::nullopt;
  constexpr std::optional<cv::RotateFlags> kTurns[] = {
      std::nullopt, cv::ROTATE_90_CLOCKWISE, cv::ROTATE_180,
      cv::ROTATE_90_COUNTERCLOCKWISE};
  return kTurns[(std::lround(angle_deg / 90.0) % 4 + 4) % 4];
}

bool IsGray(AVPixelFormat format) {
  const AVPixFmtDescriptor* const description = av_pix_fmt_desc_get(format);
  return description != nullptr && description->nb_components == 1;
}

// Sets the matrix and range with which the camera encoded colors.
void SetColorSpace(const AVFrame& frame, SwsContext* scaler) {
  const bool is_known = frame.colorspace != AVCOL_SPC_UNSPECIFIED &&
                        frame.colorspace != AVCOL_SPC_RGB;
  const int* const from = sws_getCoefficients(
      is_known ? static_cast<int>(frame.colorspace)
               : (frame.height >= 720 ? SWS_CS_ITU709 : SWS_CS_ITU601));
  const bool is_full = frame.color_range == AVCOL_RANGE_JPEG;
  constexpr int kNeutral = 1 << 16;  // contrast and saturation of 1, in 16.16
  sws_setColorspaceDetails(scaler, from, is_full ? 1 : 0,
                           sws_getCoefficients(SWS_CS_DEFAULT), 1, 0, kNeutral,
                           kNeutral);
}

cv::Mat Convert(const AVFrame& frame, cv::Size size, bool is_gray) {
  const auto from = static_cast<AVPixelFormat>(frame.format);
  const Owned<SwsContext> scaler(
      sws_getContext(frame.width, frame.height, from, size.width, size.height,
                     is_gray ? AV_PIX_FMT_GRAY8 : AV_PIX_FMT_BGR24,
                     size.width < frame.width
                         ? SWS_AREA
                         : SWS_BICUBIC | SWS_ACCURATE_RND | SWS_FULL_CHR_H_INT,
                     nullptr, nullptr, nullptr));
  if (!scaler) return {};
  SetColorSpace(frame, scaler.get());
  cv::Mat image(size, is_gray ? CV_8UC1 : CV_8UC3);
  uint8_t* const data[] = {image.data};
  const int stride[] = {static_cast<int>(image.step)};
  sws_scale(scaler.get(), frame.data, frame.linesize, 0, frame.height, data,
            stride);
  return image;
}

class FfmpegDecoder : public VideoDecoder {
 public:
  FfmpegDecoder(const fs::path& path, int num_threads)
      : file_(path),
        packet_(CheckedOwner(av_packet_alloc())),
        frame_(CheckedOwner(av_frame_alloc())),
        codec_(CheckedOwner(avcodec_alloc_context3(&file_.codec()))) {
    if (avcodec_parameters_to_context(codec_.get(), file_.stream().codecpar) <
        0) {
      throw std::bad_alloc();
    }
    codec_->thread_count = num_threads;
    codec_->max_pixels = kDefaultMaxNumPixels;
    codec_->pkt_timebase = file_.stream().time_base;
    const int code = avcodec_open2(codec_.get(), &file_.codec(), nullptr);
    if (code < 0) file_.ThrowDamaged(ReasonOf(code));
  }

  bool Next() override {
    while (true) {
      const int code = avcodec_receive_frame(codec_.get(), frame_.get());
      if (code == AVERROR_EOF) return false;
      if (code == AVERROR(EAGAIN)) {
        SendPacket();
      } else if (code >= 0 && !IsDamaged()) {
        return true;
      }
    }
  }

  int64_t TimeNs() const override {
    return file_.ToNs(frame_->best_effort_timestamp);
  }

  cv::Mat ReadPixels() const override {
    return Read(std::numeric_limits<int>::max(), false);
  }

  cv::Mat ReadSmallGray(int max_size_px) const override {
    return Read(max_size_px, true);
  }

 private:
  cv::Mat Read(int max_size_px, bool as_gray) const {
    const double scale =
        std::min(1.0, static_cast<double>(max_size_px) /
                          std::max({frame_->width, frame_->height, 1}));
    const cv::Size size(
        std::max(1, static_cast<int>(std::lround(frame_->width * scale))),
        std::max(1, static_cast<int>(std::lround(frame_->height * scale))));
    const bool is_gray =
        as_gray || IsGray(static_cast<AVPixelFormat>(frame_->format));
    cv::Mat image = Convert(*frame_, size, is_gray);
    if (image.empty()) {
      Throw(file_.path(),
            "has images that cannot be converted to 8 bits; convert it to "
            "H.264, for instance");
    }
    if (const auto turn = TurnOf(file_.stream())) {
      cv::rotate(image, image, *turn);
    }
    return image;
  }

  // At the end of the file, the decoder returns the images it still holds.
  void SendPacket() {
    const bool has_packet = file_.ReadPacket(packet_.get());
    // A packet that the decoder rejects contains no image.
    std::ignore =
        avcodec_send_packet(codec_.get(), has_packet ? packet_.get() : nullptr);
  }

  bool IsDamaged() const {
    return (frame_->flags & AV_FRAME_FLAG_CORRUPT) != 0 ||
           frame_->decode_error_flags != 0 ||
           frame_->best_effort_timestamp == AV_NOPTS_VALUE;
  }

  VideoFile file_;
  Owned<AVPacket> packet_;
  Owned<AVFrame> frame_;
  Owned<AVCodecContext> codec_;
};

}  // namespace

VideoIndex IndexVideo(const fs::path& path) {
  VideoFile file(path);
  VideoIndex index;
  index.creation_time_ns = CreationTimeNs(file.format());
  const Owned<AVPacket> packet = CheckedOwner(av_packet_alloc());
  while (file.ReadPacket(packet.get())) {
    if ((packet->flags & AV_PKT_FLAG_DISCARD) != 0) continue;
    if (packet->pts == AV_NOPTS_VALUE) {
      Throw(path,
            "has no time stamps; convert it to MP4 or MKV with another "
            "program");
    }
    index.times_ns.push_back(file.ToNs(packet->pts));
  }
  if (index.times_ns.empty()) file.ThrowDamaged("it has no images");
  const auto num_images = static_cast<int64_t>(index.times_ns.size());
  index.is_cut_off = file.is_cut_off() || num_images < file.stream().nb_frames;
  SortUnique(&index.times_ns);
  return index;
}

std::unique_ptr<VideoDecoder> OpenVideo(const fs::path& path, int num_threads) {
  return std::make_unique<FfmpegDecoder>(path, num_threads);
}

}  // namespace mgsfm
