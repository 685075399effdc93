// SPDX-License-Identifier: Apache-2.0
// Keeps decoded views in memory under a byte budget and decodes ahead on background threads.
#include "lib/scene/image_cache.h"

#include <utility>

#include "kernels/base/clock.h"

namespace gs {
namespace {

std::size_t bytes_of(const ViewImage& image) { return image.color.bytes() + (image.mask ? image.mask->bytes() : 0); }

}  // namespace

ImageCache::ImageCache(const std::vector<View>& views, std::size_t budget_bytes, int prefetch_threads)
    : views_(views), budget_bytes_(budget_bytes), entries_(views.size()) {
    try {
        for (int i = 0; i < prefetch_threads; ++i) threads_.emplace_back([this] { work(); });
    } catch (...) {  // first end the threads that were started
        stop();
        throw;
    }
}

ImageCache::~ImageCache() { stop(); }

void ImageCache::stop() {
    {
        const std::lock_guard lock(mutex_);
        stop_ = true;
    }
    queued_.notify_all();
    for (std::thread& thread : threads_) thread.join();
}

std::shared_ptr<const ViewImage> ImageCache::get(std::size_t index) {
    std::unique_lock lock(mutex_);
    Entry& entry = entries_.at(index);
    if (entry.state == State::kReady) return take(index);
    const double start = seconds_now();
    // Before this thread wakes up, another thread may take the image and, with a small budget, drop it. Then decode
    // here.
    while (entry.state != State::kReady && entry.state != State::kFailed) {
        if (entry.state == State::kLoading)
            loaded_.wait(lock);
        else
            load(index, lock);
    }
    wait_seconds_ += seconds_now() - start;
    if (entry.state == State::kReady) return take(index);
    entry.state = State::kAbsent;
    entry.pinned = false;
    std::rethrow_exception(std::exchange(entry.error, nullptr));
}

void ImageCache::prefetch(std::size_t index) {
    if (threads_.empty()) return;
    {
        const std::lock_guard lock(mutex_);
        Entry& entry = entries_.at(index);
        if (entry.state == State::kReady) entry.pinned = true;  // keeps the image until it is used
        if (entry.state != State::kAbsent) return;
        entry.state = State::kQueued;
        entry.pinned = true;
        queue_.push_back(index);
    }
    queued_.notify_one();
}

double ImageCache::wait_seconds() const {
    const std::lock_guard lock(mutex_);
    return wait_seconds_;
}

std::size_t ImageCache::resident_bytes() const {
    const std::lock_guard lock(mutex_);
    return resident_bytes_;
}

std::uint64_t ImageCache::num_decodes() const {
    const std::lock_guard lock(mutex_);
    return num_decodes_;
}

void ImageCache::work() {
    std::unique_lock lock(mutex_);
    while (true) {
        queued_.wait(lock, [this] { return stop_ || !queue_.empty(); });
        if (stop_) return;
        const std::size_t index = queue_.front();
        queue_.pop_front();
        // A `get` may already have decoded the queued view.
        if (entries_[index].state == State::kQueued) load(index, lock);
    }
}

/// Decodes without holding the lock. Afterwards the entry is kReady or kFailed.
void ImageCache::load(std::size_t index, std::unique_lock<std::mutex>& lock) {
    Entry& entry = entries_[index];
    entry.state = State::kLoading;
    num_decodes_ += !views_[index].decoded;
    lock.unlock();
    std::shared_ptr<const ViewImage> image;
    std::exception_ptr error;
    try {
        image = view_image(views_[index]);
    } catch (...) {
        error = std::current_exception();
    }
    lock.lock();
    entry.error = error;
    entry.state = error ? State::kFailed : State::kReady;
    if (image) {
        // Pinned until a `get` takes it, even if `get` itself decodes: evict() must not drop it before.
        entry.pinned = true;
        resident_bytes_ += bytes_of(*image);
        entry.image = std::move(image);
        recency_.push_front(index);
        entry.recency = recency_.begin();
        evict();
    }
    loaded_.notify_all();
}

std::shared_ptr<const ViewImage> ImageCache::take(std::size_t index) {
    Entry& entry = entries_[index];
    entry.pinned = false;
    recency_.splice(recency_.begin(), recency_, entry.recency);
    std::shared_ptr<const ViewImage> image = entry.image;
    evict();
    return image;
}

void ImageCache::evict() {
    for (auto it = recency_.end(); resident_bytes_ > budget_bytes_ && it != recency_.begin();) {
        --it;
        Entry& entry = entries_[*it];
        if (entry.pinned) continue;
        resident_bytes_ -= bytes_of(*entry.image);
        entry.image.reset();
        entry.state = State::kAbsent;
        it = recency_.erase(it);
    }
}

}  // namespace gs
