// How the block lies in memory: a header, what does not change, then two rings of slots. A slot's sequence number is
// odd while it is written; frame n (from 1) lies in slot n % count and is whole when its slot says 2 n both before and
// after it was copied.
#pragma once

#include <atomic>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <system_error>

#include "firmware/published/block.h"

namespace finsight::block {

inline constexpr char kMagic[8] = {'F', 'I', 'N', 'S', 'I', 'G', 'H', 'T'};
inline constexpr std::uint64_t kFrameSlots = 8, kPictureSlots = 3;

struct Header {
  char magic[8];
  std::uint32_t version, frame_bytes;  ///< frame_bytes: sizeof(PublishedFrame), whose layout the version stands for
  std::uint64_t file_bytes;
  std::uint32_t shape_points, width_px, height_px, about_bytes;
  std::uint64_t newest_frame, newest_picture;  ///< 0: none yet
};
static_assert(std::is_trivially_copyable_v<Header>);

struct Slot {
  std::uint64_t sequence;
  std::uint64_t number;  ///< of the frame
};

constexpr std::size_t padded(std::size_t bytes) { return (bytes + 63) / 64 * 64; }

/// Where everything is; follows from the header's sizes.
struct Layout {
  std::size_t frame_slot, picture_slot, about, frames, pictures, end;
  explicit Layout(const Header& h) {
    frame_slot =
        padded(sizeof(Slot) + sizeof(PublishedFrame) + sizeof(std::uint64_t) + std::size_t{6} * h.shape_points);
    picture_slot = padded(sizeof(Slot) + std::size_t{h.width_px} * h.height_px);
    about = padded(sizeof(Header));
    frames = padded(about + h.about_bytes);
    pictures = frames + kFrameSlots * frame_slot;
    end = pictures + (h.width_px ? kPictureSlots * picture_slot : 0);
  }
};

inline std::atomic_ref<std::uint64_t> word(std::uint64_t& value) { return std::atomic_ref<std::uint64_t>(value); }
static_assert(std::atomic_ref<std::uint64_t>::is_always_lock_free);  // or it would not hold between processes

/// Writes number `n` (from 1) into its slot; `fill` gets the slot's bytes behind its head.
template <class Fill>
void write_slot(std::byte* ring, std::size_t slot_bytes, std::uint64_t slots, std::uint64_t n, const Fill& fill) {
  std::byte* at = ring + n % slots * slot_bytes;
  Slot& slot = *reinterpret_cast<Slot*>(at);
  word(slot.sequence).store(2 * n - 1, std::memory_order_relaxed);
  std::atomic_thread_fence(std::memory_order_release);
  fill(slot, at + sizeof(Slot));
  word(slot.sequence).store(2 * n, std::memory_order_release);
}

/// False: not whole, because the writer has come round to it.
template <class Take>
bool read_slot(const std::byte* ring, std::size_t slot_bytes, std::uint64_t slots, std::uint64_t n, const Take& take) {
  const std::byte* at = ring + n % slots * slot_bytes;
  // The mapping is read-only; a reference for an atomic load needs no more.
  Slot& slot = *const_cast<Slot*>(reinterpret_cast<const Slot*>(at));
  if (word(slot.sequence).load(std::memory_order_acquire) != 2 * n) return false;
  take(slot, at + sizeof(Slot));
  std::atomic_thread_fence(std::memory_order_acquire);
  return word(slot.sequence).load(std::memory_order_relaxed) == 2 * n;
}

/// Of a call that set errno.
[[noreturn]] inline void fail(const std::filesystem::path& file, const char* what) {
  throw std::system_error(errno, std::generic_category(), file.string() + ": " + what);
}

}  // namespace finsight::block
