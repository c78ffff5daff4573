//! Why a service of the bus could not be opened, as far as it matters: iceoryx2 has an error type for each pattern.

use std::path::Path;

use iceoryx2::service::builder::event::{EventOpenError, EventOpenOrCreateError};
use iceoryx2::service::builder::publish_subscribe::{
    PublishSubscribeOpenError, PublishSubscribeOpenOrCreateError,
};
use iceoryx2::service::builder::request_response::{
    RequestResponseOpenError, RequestResponseOpenOrCreateError,
};

use crate::error::{BusError, system};

/// What kind of trouble an error is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Trouble {
    /// Whoever made the service was built differently: other types, another quality, another iceoryx2.
    Mismatch,
    /// The service is another user's.
    Permission,
    /// Anything else: the operating system refused.
    System,
}

/// An error of opening a service.
pub(crate) trait OpenError: std::fmt::Debug {
    /// Its kind.
    fn trouble(&self) -> Trouble;

    /// The error of opening `name`, a `what`, of the instance at `root`.
    fn explain(&self, root: &Path, what: &str, name: &str) -> BusError
    where
        Self: Sized,
    {
        match self.trouble() {
            Trouble::Mismatch => BusError::Version { topic: name.to_owned() },
            Trouble::Permission => BusError::Permission { path: root.to_path_buf() },
            Trouble::System => system(format!("opening {what} `{name}`"), self),
        }
    }
}

impl OpenError for PublishSubscribeOpenOrCreateError {
    fn trouble(&self) -> Trouble {
        use PublishSubscribeOpenError as E;
        let Self::PublishSubscribeOpenError(error) = self else { return Trouble::System };
        match error {
            E::IncompatibleTypes
            | E::IncompatibleMessagingPattern
            | E::IncompatibleAttributes
            | E::IncompatibleOverflowBehavior
            | E::DoesNotSupportRequestedMinBufferSize
            | E::DoesNotSupportRequestedMinHistorySize
            | E::DoesNotSupportRequestedMinSubscriberBorrowedSamples
            | E::DoesNotSupportRequestedAmountOfPublishers
            | E::DoesNotSupportRequestedAmountOfSubscribers
            | E::DoesNotSupportRequestedAmountOfNodes
            | E::VersionMismatch
            // A description that this iceoryx2 cannot read was written by another one.
            | E::ServiceInCorruptedState => Trouble::Mismatch,
            E::InsufficientPermissions => Trouble::Permission,
            _ => Trouble::System,
        }
    }
}

impl OpenError for EventOpenOrCreateError {
    fn trouble(&self) -> Trouble {
        use EventOpenError as E;
        let Self::EventOpenError(error) = self else { return Trouble::System };
        match error {
            E::IncompatibleMessagingPattern
            | E::IncompatibleAttributes
            | E::IncompatibleDeadline
            | E::IncompatibleNotifierCreatedEvent
            | E::IncompatibleNotifierDroppedEvent
            | E::IncompatibleNotifierDeadEvent
            | E::DoesNotSupportRequestedAmountOfNotifiers
            | E::DoesNotSupportRequestedAmountOfListeners
            | E::DoesNotSupportRequestedMaxEventId
            | E::DoesNotSupportRequestedAmountOfNodes
            | E::VersionMismatch
            | E::ServiceInCorruptedState => Trouble::Mismatch,
            E::InsufficientPermissions => Trouble::Permission,
            _ => Trouble::System,
        }
    }
}

impl OpenError for RequestResponseOpenOrCreateError {
    fn trouble(&self) -> Trouble {
        use RequestResponseOpenError as E;
        let Self::RequestResponseOpenError(error) = self else { return Trouble::System };
        match error {
            E::IncompatibleRequestOrResponseType
            | E::IncompatibleMessagingPattern
            | E::IncompatibleAttributes
            | E::IncompatibleOverflowBehaviorForRequests
            | E::IncompatibleOverflowBehaviorForResponses
            | E::IncompatibleBehaviorForFireAndForgetRequests
            | E::DoesNotSupportRequestedAmountOfClientRequestLoans
            | E::DoesNotSupportRequestedAmountOfActiveRequestsPerClient
            | E::DoesNotSupportRequestedResponseBufferSize
            | E::DoesNotSupportRequestedAmountOfServers
            | E::DoesNotSupportRequestedAmountOfClients
            | E::DoesNotSupportRequestedAmountOfNodes
            | E::DoesNotSupportRequestedAmountOfBorrowedResponsesPerPendingResponse
            | E::VersionMismatch
            | E::ServiceInCorruptedState => Trouble::Mismatch,
            E::InsufficientPermissions => Trouble::Permission,
            _ => Trouble::System,
        }
    }
}
