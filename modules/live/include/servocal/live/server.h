// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "servocal/core/cell_config.h"
#include "servocal/procedure/calibrate.h"

namespace servocal::live {

struct ServerOptions {
  std::string host = "127.0.0.1";  ///< Address or name to listen at; "0.0.0.0": all of this machine's.
  int port = 0;                    ///< 0: any that is free.
};

/// The page that shows a run while it goes on, with one control: a button that stops the arm.
///
/// show() hands over and returns: it never waits for a browser, and of frames that nobody fetched only the
/// newest is kept. JPEGs and JSON are made in the server's threads, once for all who watch, and only if
/// somebody asks.
///
/// Every request needs the token in url(), drawn anew for each server; a request that names another host than
/// an address, "localhost" or ServerOptions::host is refused (DNS rebinding). The connection is not
/// encrypted: in a network that others listen to, use an ssh tunnel. The button is not an emergency stop.
class Server {
 public:
  /// Listens from now on. `stop` is called from a thread of the server when somebody presses the button,
  /// maybe more than once; robot::Guard::operatorStop() is made for it.
  /// @throws Error (kNothingToDo) if host and port cannot be listened at.
  Server(const CellConfig& cell, std::function<void()> stop, const ServerOptions& options = {});
  ~Server();
  Server(const Server&) = delete;
  Server& operator=(const Server&) = delete;

  /// Address of the page, token included.
  const std::string& url() const;

  void show(const procedure::Event& event);
  void show(const procedure::Look& look);

  /// The run is over: the page shows the sentence from now on. Waits until those who watch have it, at most 2
  /// s; not at all if nobody does.
  void finish(bool goal_met, const std::string& verdict);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace servocal::live
