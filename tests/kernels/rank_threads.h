// SPDX-License-Identifier: Apache-2.0
// Ranks as threads of one process, connected by sockets like processes.
#pragma once

#include <sys/socket.h>

#include <stdexcept>
#include <thread>

#include "kernels/ranks/backend.h"
#include "kernels/ranks/socket_communicator.h"

namespace gs::test {

/// Returns a socket of each of `size` ranks to each other.
inline std::vector<std::vector<Descriptor>> sockets_between(int size) {
    std::vector<std::vector<Descriptor>> sockets;
    sockets.resize(std::size_t(size));
    for (auto& of_rank : sockets) of_rank.resize(sockets.size());
    for (std::size_t a = 0; a < sockets.size(); ++a)
        for (std::size_t b = 0; b < a; ++b) {
            int ends[2];
            if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0) throw std::runtime_error("no sockets");
            sockets[a][b] = Descriptor(ends[0]), sockets[b][a] = Descriptor(ends[1]);
        }
    return sockets;
}

/// Calls run(communicator) on `size` ranks at once; a single one needs no connection. Exceptions of rank 0 are
/// rethrown, when the other ranks have ended.
template <class Fn> void on_ranks(int size, Fn&& run) {
    if (size == 1) {
        SingleRank one;
        return run(one);
    }
    auto sockets = sockets_between(size);
    std::exception_ptr error;
    std::vector<std::thread> threads;
    for (int rank = 0; rank < size; ++rank)
        threads.emplace_back([&, rank] {
            try {
                const auto ranks = connect_by_sockets(rank, std::move(sockets[std::size_t(rank)]));
                run(*ranks);
            } catch (...) {
                if (rank == 0) error = std::current_exception();
            }
        });
    for (std::thread& thread : threads) thread.join();
    if (error) std::rethrow_exception(error);
}

/// Calls use(backend) with a model that `size` ranks hold, each on a backend of its own.
template <class Fn, class Make>
void with_ranked_backend(int size, int views_per_step, const TargetSource& targets, Fn&& use, Make&& make) {
    on_ranks(size, [&](Communicator& ranks) {
        std::unique_ptr<Engine> own = make();
        if (ranks.rank() > 0) return follow(ranks, *own, targets);
        Backend backend(std::move(own), &ranks, views_per_step);
        use(backend);
    });
}

/// The same on the CPU.
template <class Fn>
void with_ranked_backend(int size, int views_per_step, const AppearanceSpec& appearance, const TargetSource& targets,
                         Fn&& use) {
    with_ranked_backend(size, views_per_step, targets, use, [&] { return make_cpu_engine(appearance); });
}

}  // namespace gs::test
