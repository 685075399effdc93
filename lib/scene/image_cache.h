// SPDX-License-Identifier: Apache-2.0
// Keeps decoded views in memory under a byte budget and decodes ahead on background threads.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <exception>
#include <list>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "lib/scene/scene.h"

namespace gs {

/// Cache of decoded views that keeps images while their total fits the budget. The least recently used images are
/// dropped and decoded again when requested. Prefetched images stay until their `get` even beyond the budget, so the
/// excess is at most the images in flight (prefetched or being decoded). All members may be called from any thread.
class ImageCache {
  public:
    /// `views` must outlive the cache. A budget of 0 keeps nothing. With no prefetch threads `prefetch` does nothing.
    ImageCache(const std::vector<View>& views, std::size_t budget_bytes, int prefetch_threads);
    /// Waits for decodes in progress; drops queued ones.
    ~ImageCache();
    ImageCache(const ImageCache&) = delete;
    ImageCache& operator=(const ImageCache&) = delete;

    /// Returns the decoded view, shared with the cache. Decodes on the calling thread unless another thread is already
    /// decoding it. Throws the error of View::load, even if it occurred in a prefetch; the next `get` tries again.
    std::shared_ptr<const ViewImage> get(std::size_t index);

    /// Queues a decode unless the view is decoded, queued, or being decoded.
    void prefetch(std::size_t index);

    double wait_seconds() const;         ///< total time that `get` spent decoding or waiting
    std::size_t resident_bytes() const;  ///< bytes of all images now in the cache
    std::uint64_t num_decodes() const;   ///< number of calls of View::load so far

  private:
    enum class State { kAbsent, kQueued, kLoading, kReady, kFailed };
    struct Entry {
        State state = State::kAbsent;
        bool pinned = false;  ///< prefetched and not yet taken
        std::shared_ptr<const ViewImage> image;
        std::exception_ptr error;
        std::list<std::size_t>::iterator recency;  ///< valid while kReady
    };

    void work();
    void stop();
    void load(std::size_t index, std::unique_lock<std::mutex>& lock);
    std::shared_ptr<const ViewImage> take(std::size_t index);
    void evict();

    const std::vector<View>& views_;
    const std::size_t budget_bytes_;
    mutable std::mutex mutex_;
    std::condition_variable queued_, loaded_;
    std::vector<Entry> entries_;
    std::list<std::size_t> recency_;  ///< kReady entries, most recently used first
    std::deque<std::size_t> queue_;
    std::size_t resident_bytes_ = 0;
    std::uint64_t num_decodes_ = 0;
    double wait_seconds_ = 0;
    bool stop_ = false;
    std::vector<std::thread> threads_;
};

}  // namespace gs
